#include "pipeline/pipeline.h"

#include <spdlog/spdlog.h>

namespace portolan {
namespace {
constexpr RobotId kRobot = 0;
}  // namespace

Pipeline::Pipeline(const TrackerOptions& tracker_options, const MapperOptions& mapper_options, const CameraModel& camera,
                   std::shared_ptr<const Vocabulary> vocabulary, uint32_t session)
    : session_(session), mapper_options_(mapper_options), vocabulary_(vocabulary), tracker_(tracker_options, camera, vocabulary, kRobot, session) {
  MapperState idle;
  idle.idle = true;
  tracker_.OnMapperState(idle);
}

Tracker::Output Pipeline::Track(const Image& image) {
  Tracker::Output output = tracker_.Track(image);
  for (const MapId map : output.new_maps) {
    mappers_[map] = std::make_unique<LocalMapper>(mapper_options_, map, next_epoch_++, kRobot, session_,
                                                  [this](MapDelta delta) { tracker_.AddDelta(std::move(delta)); });
  }
  for (const KeyFrameMessage& message : output.keyframes) Map(message);
  tracker_.ApplyPending();
  return output;
}

void Pipeline::Map(const KeyFrameMessage& message) {
  LocalMapper& mapper = *mappers_.at(message.map);
  auto data = MakeKeyFrameData(message.data, vocabulary_.get());
  MapperState state;
  state.map = message.map;
  state.idle = true;
  Status status = Ok{};
  if (message.kind == KeyFrameKind::kInitialFirst) {
    firsts_ = {{data->id, data}};
    return;
  }
  if (message.kind == KeyFrameKind::kInitialSecond) {
    status = mapper.Initialize(firsts_.at(message.reference), data, message);
  } else {
    status = mapper.Process(data, message, [] { return false; }, nullptr);
  }
  state.last_keyframe = data->id;
  state.residual = mapper.residual();
  if (!state.residual.IsNone()) mapper_options_.lens.enabled = false;  // new maps are made of frames that have it taken in
  if (!status) {
    spdlog::debug("keyframe {} refused: {}", ToString(data->id), status.error().message);
    state.refused_keyframe = data->id;
    state.refusal = status.error().message;
  }
  tracker_.OnMapperState(state);
}

}  // namespace portolan
