#include "messages/random_messages.h"

#include <string>

#include "features/feature_quantization.h"

namespace portolan {
namespace {

template <class IdType>
IdType RandomId(Random* random) {
  return IdType(static_cast<RobotId>(random->Below(8)), 1 + static_cast<uint32_t>(random->Below(1000)),
                1 + static_cast<uint32_t>(random->Below(100000)));
}

uint32_t RandomCount(Random* random) {
  return static_cast<uint32_t>(random->Below(1000));
}

std::string RandomText(Random* random) {
  return "text \xc3\xa9 " + std::to_string(random->Next());
}

Eigen::Quaterniond RandomRotation(Random* random) {
  return Eigen::Quaterniond(random->Gaussian(), random->Gaussian(), random->Gaussian(), random->Gaussian())
      .normalized();
}

Eigen::Vector3d RandomVector(Random* random) {
  return Eigen::Vector3d(random->Gaussian(), random->Gaussian(), random->Gaussian());
}

RadialResidual RandomResidual(Random* random) {
  const double k1 = random->Uniform(-0.1, 0.1);
  return {k1, random->Uniform(-0.1, 0.1)};
}

Timestamp RandomStamp(Random* random) {
  return Timestamp{static_cast<int64_t>(random->Below(2000000000000000000ull))};
}

}  // namespace

Rigid3d RandomRigid3(Random* random) {
  const Eigen::Quaterniond rotation = RandomRotation(random);
  return Rigid3d(rotation, RandomVector(random));
}

Sim3d RandomSim3(Random* random) {
  const double scale = random->Uniform(0.1, 10.0);
  const Eigen::Quaterniond rotation = RandomRotation(random);
  return Sim3d(scale, rotation, RandomVector(random));
}

FeatureSet RandomFeatures(size_t n, const PinholeCamera& camera, Random* random) {
  FeatureSet features;
  for (size_t i = 0; i < n; ++i) {
    const auto x_px = static_cast<float>(random->Uniform(0, camera.width - 1));
    const auto y_px = static_cast<float>(random->Uniform(0, camera.height - 1));
    features.pixels_px.emplace_back(x_px, y_px);
    features.octaves.push_back(static_cast<uint8_t>(random->Below(8)));
    features.angles_rad.push_back(static_cast<float>(random->Uniform(0, 2 * M_PI)));
    features.descriptors.push_back(Descriptor{random->Next(), random->Next(), random->Next(), random->Next()});
  }
  QuantizeFeatures(&features, camera);
  return features;
}

KeyFrameMessage RandomKeyFrame(size_t n, Random* random) {
  KeyFrameMessage message;
  message.data.id = RandomId<KeyFrameId>(random);
  message.data.stamp = RandomStamp(random);
  message.data.frame = random->Below(100000);
  message.data.camera = PinholeCamera{718.9, 718.9, 607.2, 185.2, 1241, 376};
  message.data.residual = RandomResidual(random);
  message.data.features = RandomFeatures(n, message.data.camera, random);
  message.vocabulary_hash = random->Next();
  message.map = RandomId<MapId>(random);
  message.reference = RandomId<KeyFrameId>(random);
  message.camera_from_map = RandomRigid3(random);
  for (uint32_t feature = 0; feature < n; feature += 2)
    message.landmarks.emplace_back(feature, RandomId<MapPointId>(random));
  return message;
}

MapDeltaChunk RandomDelta(size_t n, Random* random) {
  MapDeltaChunk chunk;
  chunk.count = 1 + static_cast<uint32_t>(random->Below(5));
  chunk.index = static_cast<uint32_t>(random->Below(chunk.count));
  MapDelta& delta = chunk.part;
  delta.map = RandomId<MapId>(random);
  delta.epoch = random->Below(10);
  delta.base_revision = random->Below(1000);
  delta.revision = delta.base_revision + 1;
  delta.residuals = {{PinholeCamera{718.9, 718.9, 607.2, 185.2, 1241, 376}, RandomResidual(random)}};
  delta.removed_points = {{RandomId<MapPointId>(random), MapPointId()},
                          {RandomId<MapPointId>(random), RandomId<MapPointId>(random)}};
  delta.removed_keyframes = {{RandomId<KeyFrameId>(random), RandomId<KeyFrameId>(random), RandomRigid3(random)}};
  for (size_t i = 0; i < 1 + n / 100; ++i) {
    delta.keyframes.push_back(
        {RandomId<KeyFrameId>(random), RandomRigid3(random), RandomId<KeyFrameId>(random), RandomCount(random)});
  }
  for (size_t i = 0; i < n; ++i) {
    const MapPointId point = RandomId<MapPointId>(random);
    delta.points.push_back({point, RandomVector(random).cast<float>()});
    for (int k = 0; k < 5; ++k) {
      const KeyFrameId keyframe = delta.keyframes[random->Below(delta.keyframes.size())].id;
      delta.observations.push_back({point, keyframe, static_cast<int32_t>(random->Below(2001)) - 1});
    }
  }
  return chunk;
}

SnapshotRequest RandomSnapshotRequest(Random* random) {
  SnapshotRequest request;
  request.map = RandomId<MapId>(random);
  request.have_revision = random->Below(1000);
  for (int i = 0; i < 10; ++i) request.have_keyframes.push_back(RandomId<KeyFrameId>(random));
  request.asker = RandomId<ProcessId>(random);
  return request;
}

MapCorrection RandomCorrection(Random* random) {
  MapCorrection correction;
  correction.process = RandomId<ProcessId>(random);
  correction.number = random->Below(100);
  correction.map = RandomId<MapId>(random);
  correction.epoch = random->Below(10);
  correction.made_from_revision = random->Below(1000);
  correction.kind = "fusion";
  correction.other = MapId(4, 5, 6);
  correction.map_from_other = RandomSim3(random);
  for (int i = 0; i < 10; ++i) correction.keyframes.push_back({RandomId<KeyFrameId>(random), RandomSim3(random)});
  for (int i = 0; i < 100; ++i)
    correction.points.push_back({RandomId<MapPointId>(random), RandomVector(random).cast<float>()});
  correction.merges = {{MapPointId(1, 2, 3), MapPointId(1, 2, 4)}};
  correction.observations = {{MapPointId(1, 2, 4), Observation{KeyFrameId(1, 2, 3), 17}}};
  correction.loop_edges = {{KeyFrameId(1, 2, 3), KeyFrameId(1, 2, 4)}};
  return correction;
}

Command RandomCommand(Random* random) {
  Command command;
  command.number = random->Below(1000);
  command.sender = RandomId<ProcessId>(random);
  command.kind = static_cast<CommandKind>(random->Below(16));
  command.map = MapId(1, 2, 3);
  command.other = RandomId<MapId>(random);
  command.epoch = 1 + random->Below(10);
  command.owner = RandomId<ProcessId>(random);
  command.robot = static_cast<RobotId>(random->Below(100));
  command.map_from_other = RandomSim3(random);
  return command;
}

Request RandomRequest(Random* random) {
  return Request{RandomId<RequestId>(random), RandomId<ProcessId>(random), "save",
                 RandomId<MapId>(random),     RandomId<MapId>(random),     RandomSim3(random),
                 RandomText(random)};
}

Reply RandomReply(Random* random) {
  return Reply{RandomId<RequestId>(random), RandomId<ProcessId>(random), random->Below(2) == 1, RandomText(random),
               RandomText(random)};
}

TrackerState RandomTrackerState(Random* random) {
  TrackerState state;
  state.process = RandomId<ProcessId>(random);
  state.frame = random->Below(100000);
  state.stamp = RandomStamp(random);
  state.state = static_cast<TrackingState>(random->Below(4));
  state.map = RandomId<MapId>(random);
  state.camera_from_map = RandomRigid3(random);
  state.quality = static_cast<float>(random->Uniform());
  state.num_inliers = RandomCount(random);
  state.num_candidates = RandomCount(random);
  state.frame_ms = static_cast<float>(random->Uniform(1, 50));
  state.interrupt_mapper = random->Below(2) == 1;
  return state;
}

MapperState RandomMapperState(Random* random) {
  MapperState state;
  state.process = RandomId<ProcessId>(random);
  state.map = RandomId<MapId>(random);
  state.epoch = random->Below(10);
  state.revision = random->Below(1000);
  state.idle = random->Below(2) == 1;
  state.queue_depth = RandomCount(random);
  state.last_keyframe = RandomId<KeyFrameId>(random);
  state.refused_keyframe = RandomId<KeyFrameId>(random);
  state.refusal = RandomText(random);
  state.is_refining = random->Below(2) == 1;
  state.correction_process = RandomId<ProcessId>(random);
  state.correction_number = random->Below(100);
  state.correction_refusal = RandomText(random);
  return state;
}

FollowerState RandomFollowerState(Random* random) {
  FollowerState state;
  state.process = RandomId<ProcessId>(random);
  state.map = RandomId<MapId>(random);
  state.epoch = random->Below(10);
  state.last_keyframe = RandomId<KeyFrameId>(random);
  state.is_busy = random->Below(2) == 1;
  state.revision = random->Below(1000);
  return state;
}

ProcessStatus RandomProcessStatus(Random* random) {
  ProcessStatus status;
  status.process = RandomId<ProcessId>(random);
  status.role = "backend_mapper";
  status.host = "host";
  status.pid = RandomCount(random);
  status.vendor = "fastdds";
  status.build = "test";
  status.priority = "nice -5";
  status.state = RandomText(random);
  status.map = RandomId<MapId>(random);
  status.epoch = random->Below(10);
  status.revision = random->Below(1000);
  status.figures = {{"queue", 3.0}, {"ms", random->Uniform()}};
  return status;
}

Image RandomImage(int width, int height, Random* random) {
  Image image;
  image.stamp = RandomStamp(random);
  image.grey.create(height, width, CV_8UC1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.grey.at<uint8_t>(y, x) = static_cast<uint8_t>(random->Below(256));
  }
  return image;
}

}  // namespace portolan
