#include "fuzzing/fuzz_targets.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <utility>

#include "base/check.h"
#include "base/hash.h"
#include "dataset/compressed_image.h"
#include "dataset/plot_canvas.h"
#include "map/map_changes.h"
#include "map/map_io.h"
#include "map/random_edits.h"
#include "map/replica_set.h"
#include "map_optimization/map_correction.h"
#include "map_optimization/map_fusion.h"
#include "messages/command_messages.h"
#include "messages/correction_messages.h"
#include "messages/delta_messages.h"
#include "messages/image_messages.h"
#include "messages/keyframe_messages.h"
#include "messages/random_messages.h"
#include "messages/status_messages.h"
#include "messages/wire_codec.h"

namespace portolan {
namespace {

using Bytes = std::vector<uint8_t>;

const ProcessId kAsker(0, 9, 1);

/// Of one sample: the domain type, or why there is none.
template <class Wire>
auto TakeIn(const uint8_t* data, size_t size) -> decltype(FromWire(std::declval<Wire>())) {
  const Result<Wire> decoded = DecodeSample<Wire>(data, size);
  if (!decoded) return decoded.error();
  return FromWire(*decoded);
}

/// What is taken in goes out again: a process hands on what it hears.
template <class Wire>
FuzzOutcome TakeInAndOut(const uint8_t* data, size_t size) {
  const auto message = TakeIn<Wire>(data, size);
  if (!message) return {};
  EncodeSample(ToWire(*message));
  return {1, 0};
}

void RequireValid(const Map& map) {
  const std::vector<std::string> problems = ValidateMap(map);
  PORTOLAN_CHECK(problems.empty()) << "map " << map.id() << ": " << problems.front();
}

// keyframe

FuzzOutcome RunKeyFrame(const uint8_t* data, size_t size) {
  auto message = TakeIn<wire::KeyFrame>(data, size);
  if (!message) return {};
  EncodeSample(ToWire(*message));
  const auto complete = MakeKeyFrameData(std::move(message->data), nullptr);
  return {complete->features.size() <= size ? 1 : 0, 0};  // nothing came of nothing
}

std::vector<Bytes> MakeKeyFrameSeeds() {
  Random random(1);
  std::vector<Bytes> seeds;
  for (const size_t features : {0, 1, 7, 40}) seeds.push_back(EncodeSample(ToWire(RandomKeyFrame(features, &random))));
  return seeds;
}

// replica

enum ReplicaTopic : uint8_t { kKeyFrameTopic = 0, kDeltaTopic = 1, kNumReplicaTopics = 2 };

/// Calls take(topic, data, size) for each message of a row; a length that runs over the end is cut.
template <class Take>
void ForEachMessage(const uint8_t* data, size_t size, Take take) {
  constexpr size_t kHeader = 3;
  while (size >= kHeader) {
    const size_t length = std::min<size_t>(data[1] | data[2] << 8, size - kHeader);
    take(data[0], data + kHeader, length);
    data += kHeader + length;
    size -= kHeader + length;
  }
}

void AppendMessage(uint8_t topic, const Bytes& sample, Bytes* row) {
  PORTOLAN_CHECK(sample.size() <= 0xffff) << sample.size() << " bytes";
  row->push_back(topic);
  row->push_back(static_cast<uint8_t>(sample.size() & 0xff));
  row->push_back(static_cast<uint8_t>(sample.size() >> 8));
  row->insert(row->end(), sample.begin(), sample.end());
}

FuzzOutcome RunReplica(const uint8_t* data, size_t size) {
  FuzzOutcome outcome;
  ReplicaSet replicas;
  double now_s = 0;
  ForEachMessage(data, size, [&](uint8_t topic, const uint8_t* sample, size_t length) {
    if (topic % kNumReplicaTopics == kKeyFrameTopic) {
      if (auto message = TakeIn<wire::KeyFrame>(sample, length)) {
        ++outcome.taken_in;
        replicas.AddKeyFrameData(message->map, MakeKeyFrameData(std::move(message->data), nullptr));
      }
    } else if (auto chunk = TakeIn<wire::MapDelta>(sample, length)) {
      ++outcome.taken_in;
      replicas.AddChunk(std::move(*chunk));
    }
    for (const MapDelta& delta : replicas.ApplyPending()) {
      ++outcome.applied;
      replicas.Announce(delta.map, delta.epoch, delta.revision);
    }
    for (const SnapshotRequest& request : replicas.DueRequests(now_s, kAsker)) EncodeSample(ToWire(request));
    now_s += 1;
  });
  for (const auto& [id, replica] : replicas.replicas()) RequireValid(replica.map());
  return outcome;
}

std::vector<Bytes> MakeReplicaSeeds() {
  std::vector<Bytes> seeds;
  for (const uint64_t seed : {1, 2, 3, 4}) {
    Bytes row;
    Map map(MapId(0, 1, 1), 1);
    RandomEdits edits(seed, &map);
    std::set<KeyFrameId> sent;
    const auto send = [&](const MapDelta& delta) {
      for (const auto& [id, data] : edits.data()) {
        if (!sent.insert(id).second) continue;
        KeyFrameMessage message;
        message.data = *data;
        message.map = map.id();
        AppendMessage(kKeyFrameTopic, EncodeSample(ToWire(message)), &row);
      }
      for (const MapDeltaChunk& chunk : SplitDelta(delta, seed == 2 ? 20 : 1000))
        AppendMessage(kDeltaTopic, EncodeSample(ToWire(chunk)), &row);
    };
    for (int i = 0; i < 6; ++i) {
      edits.Next();
      const MapDelta delta = map.TakeDelta();
      if (!delta.IsEmpty()) send(delta);
    }
    if (seed == 3) {
      map.SetEpoch(2);
      send(map.Snapshot());
    }
    seeds.push_back(std::move(row));
  }
  return seeds;
}

// correction

/// A map and another, of ids that differ, as RandomEdits makes them; always the same.
struct TwoMaps {
  Map map{MapId(0, 1, 1), 1}, other{MapId(0, 1, 2), 1};

  TwoMaps() {
    RandomEdits edits(5, &map);
    for (int i = 0; i < 40; ++i) edits.Next();
    map.TakeDelta();
    for (int i = 0; i < 5; ++i) edits.Next();  // since the proposal was made
    map.TakeDelta();
    RandomEdits other_edits(6, &other, 2);
    for (int i = 0; i < 20; ++i) other_edits.Next();
    other.TakeDelta();
  }
};

FuzzOutcome RunCorrection(const uint8_t* data, size_t size) {
  const auto correction = TakeIn<wire::MapCorrection>(data, size);
  if (!correction) return {};
  EncodeSample(ToWire(*correction));
  static const TwoMaps maps;
  Map map = maps.map;
  FuzzOutcome outcome{1, 0};
  if (ApplyMapCorrection(*correction, &map)) ++outcome.applied;
  map.TakeDelta();
  RequireValid(map);
  map = maps.map;
  if (ApplyFusion(*correction, maps.other, &map)) ++outcome.applied;
  map.TakeDelta();
  RequireValid(map);
  return outcome;
}

MapCorrection SomeCorrection(const TwoMaps& maps, bool is_fusion, Random* random) {
  MapCorrection correction = EmptyCorrection(maps.map, is_fusion ? "fusion" : "loop");
  correction.process = kAsker;
  correction.made_from_revision = maps.map.revision() - 1;
  const Map& moved = is_fusion ? maps.other : maps.map;
  if (is_fusion) {
    correction.other = maps.other.id();
    correction.map_from_other = RandomSim3(random);
  }
  for (const auto& [id, keyframe] : moved.keyframes()) correction.keyframes.push_back({id, RandomSim3(random)});
  const std::vector<MapPointId> points = maps.map.SortedPointIds(), moved_points = moved.SortedPointIds();
  for (size_t i = 0; i < 5; ++i) correction.points.push_back({moved_points[i], Eigen::Vector3f(0, 1, 2)});
  correction.merges = {{moved_points[1], points[2]}, {moved_points[3], points[4]}};
  const KeyFrameId keyframe = maps.map.keyframes().begin()->first;
  correction.observations = {{points[6], {keyframe, 3}}};
  correction.loop_edges = {{moved.keyframes().rbegin()->first, keyframe}};
  return correction;
}

std::vector<Bytes> MakeCorrectionSeeds() {
  Random random(3);
  const TwoMaps maps;
  std::vector<Bytes> seeds;
  for (const bool is_fusion : {false, true})
    seeds.push_back(EncodeSample(ToWire(SomeCorrection(maps, is_fusion, &random))));
  seeds.push_back(EncodeSample(ToWire(RandomCorrection(&random))));
  return seeds;
}

// message

using Take = FuzzOutcome (*)(const uint8_t*, size_t);
constexpr Take kTopics[] = {
    &TakeInAndOut<wire::SnapshotRequest>,
    &TakeInAndOut<wire::Command>,
    &TakeInAndOut<wire::Request>,
    &TakeInAndOut<wire::Reply>,
    &TakeInAndOut<wire::TrackerState>,
    &TakeInAndOut<wire::MapperState>,
    &TakeInAndOut<wire::FollowerState>,
    &TakeInAndOut<wire::ProcessStatus>,
    &TakeInAndOut<sensor_msgs::msg::dds_::Image_>,
    [](const uint8_t* data, size_t size) -> FuzzOutcome {  // what comes of a picture goes out as another type
      return {TakeIn<sensor_msgs::msg::dds_::CompressedImage_>(data, size).ok() ? 1 : 0, 0};
    }};

FuzzOutcome RunMessage(const uint8_t* data, size_t size) {
  if (size == 0) return {};
  return kTopics[data[0] % std::size(kTopics)](data + 1, size - 1);
}

std::vector<Bytes> MakeMessageSeeds() {
  Random random(4);
  const std::string png = PlotCanvas(4, 4).ToPng();
  const std::vector<Bytes> samples = {EncodeSample(ToWire(RandomSnapshotRequest(&random))),
                                      EncodeSample(ToWire(RandomCommand(&random))),
                                      EncodeSample(ToWire(RandomRequest(&random))),
                                      EncodeSample(ToWire(RandomReply(&random))),
                                      EncodeSample(ToWire(RandomTrackerState(&random))),
                                      EncodeSample(ToWire(RandomMapperState(&random))),
                                      EncodeSample(ToWire(RandomFollowerState(&random))),
                                      EncodeSample(ToWire(RandomProcessStatus(&random))),
                                      EncodeSample(ToWire(RandomImage(8, 6, &random))),
                                      EncodeSample(ToWire(CompressJpeg(RandomImage(8, 8, &random)))),
                                      EncodeSample(ToWire(CompressedImage{Timestamp{}, {png.begin(), png.end()}}))};
  std::vector<Bytes> seeds;
  for (size_t i = 0; i < samples.size(); ++i) {
    Bytes seed{static_cast<uint8_t>(std::min(i, std::size(kTopics) - 1))};
    seed.insert(seed.end(), samples[i].begin(), samples[i].end());
    seeds.push_back(std::move(seed));
  }
  return seeds;
}

// stored

FuzzOutcome RunStored(const uint8_t* data, size_t size) {
  if (size == 0) return {};
  // With the hash that belongs to it: no change of a byte would get past it.
  std::string bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  Hasher hasher;
  hasher.AddBytes(bytes.data(), bytes.size());
  const uint64_t hash = hasher.Value();
  bytes.append(reinterpret_cast<const char*>(&hash), sizeof hash);
  if (data[0] % 3 == 0) return {DecodeKeyFrameData(bytes).ok() ? 1 : 0, 0};
  static const TwoMaps maps;  // which have the keyframes that it may name
  if (data[0] % 3 == 2) {
    const Result<MapDelta> change = DecodeChange(bytes);
    return {change ? 1 : 0, change && MergeChanges(maps.map.Snapshot(), {*change}) ? 1 : 0};
  }
  const Result<MapDelta> snapshot = DecodeSnapshot(bytes);
  if (!snapshot) return {};
  const auto find_data = [](KeyFrameId id) -> std::shared_ptr<const KeyFrameData> {
    const KeyFrame* keyframe = maps.map.FindKeyFrame(id);
    return keyframe != nullptr ? keyframe->data : nullptr;
  };
  Map map(snapshot->map, snapshot->epoch);
  const bool applied = map.Apply(*snapshot, find_data).ok();
  RequireValid(map);
  return {1, applied ? 1 : 0};
}

std::vector<Bytes> MakeStoredSeeds() {
  const TwoMaps maps;
  std::vector<Bytes> seeds;
  const auto add = [&](uint8_t kind, const std::string& bytes) {
    Bytes seed{kind};
    seed.insert(seed.end(), bytes.begin(), bytes.end() - sizeof(uint64_t));  // RunStored adds the hash
    seeds.push_back(std::move(seed));
  };
  add(0, EncodeKeyFrameData(*maps.map.keyframes().begin()->second.data));
  add(1, EncodeSnapshot(maps.map.Snapshot()));
  MapDelta change = maps.map.Snapshot();  // all of it once more
  change.base_revision = change.revision++;
  add(2, EncodeChange(change));
  return seeds;
}

}  // namespace

const std::vector<FuzzTarget>& FuzzTargets() {
  static const std::vector<FuzzTarget> targets = {{"keyframe", &RunKeyFrame, &MakeKeyFrameSeeds},
                                                  {"replica", &RunReplica, &MakeReplicaSeeds},
                                                  {"correction", &RunCorrection, &MakeCorrectionSeeds},
                                                  {"message", &RunMessage, &MakeMessageSeeds},
                                                  {"stored", &RunStored, &MakeStoredSeeds}};
  return targets;
}

const FuzzTarget* FindFuzzTarget(const std::string& name) {
  for (const FuzzTarget& target : FuzzTargets()) {
    if (name == target.name) return &target;
  }
  return nullptr;
}

}  // namespace portolan
