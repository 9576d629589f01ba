#include "pipeline/pipeline.h"

#include <spdlog/spdlog.h>

#include "base/check.h"

namespace portolan {
namespace {
constexpr RobotId kRobot = 0;
constexpr size_t kDeltaChunkElements = 10000;
}  // namespace

Pipeline::Pipeline(const TrackerOptions& tracker_options, const MapperOptions& mapper_options,
                   const LoopOptions& loop_options, const CameraModel& camera,
                   std::shared_ptr<const Vocabulary> vocabulary, uint32_t session)
    : point_ids_(kRobot, session),
      mapper_options_(mapper_options),
      vocabulary_(vocabulary),
      tracker_(tracker_options, camera, vocabulary, kRobot, session),
      loop_closer_(loop_options, vocabulary, ProcessId(kRobot, session, 1)) {
  MapperState idle;
  idle.idle = true;
  tracker_.OnMapperState(idle);
}

Tracker::Output Pipeline::Track(const Image& image) {
  Tracker::Output output = tracker_.Track(image);
  for (const Request& request : output.requests) Answer(request);
  for (const KeyFrameMessage& message : output.keyframes) Map(message);
  tracker_.ApplyPending();
  return output;
}

/// What the atlas_server would do.
void Pipeline::Answer(const Request& request) {
  Reply reply;
  reply.ok = request.kind != "locate";  // it keeps no map that the tracker has not
  if (request.kind == "new_map" && mappers_.count(request.map) == 0) {
    mappers_[request.map] =
        std::make_unique<LocalMapper>(mapper_options_, request.map, next_epoch_++, &point_ids_, [this](MapDelta delta) {
          for (MapDeltaChunk& chunk : SplitDelta(delta, kDeltaChunkElements)) {
            loop_closer_.follower().AddChunk(std::move(chunk));
          }
          tracker_.AddDelta(std::move(delta));
        });
  }
  tracker_.OnReply(request, reply);
}

void Pipeline::Map(const KeyFrameMessage& message) {
  if (message.kind == KeyFrameKind::kQuery) return;
  LocalMapper& mapper = *mappers_.at(message.map);
  auto data = MakeKeyFrameData(message.data, vocabulary_.get());
  loop_closer_.follower().AddKeyFrame(message);
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
    status = mapper.Process(
        data, message, [] { return false; }, nullptr);
    RefineLens(&mapper);
  }
  state.last_keyframe = data->id;
  if (!status) {
    spdlog::debug("keyframe {} refused: {}", ToString(data->id), status.error().message);
    state.refused_keyframe = data->id;
    state.refusal = status.error().message;
  }
  tracker_.OnMapperState(state);
  CloseLoops(&mapper, state);
}

void Pipeline::RefineLens(LocalMapper* mapper) {
  if (const auto problem = mapper->NextLensProblem()) {
    const LensFinding finding = FindRadialResidual(*problem, mapper_options_.lens);
    mapper->TakeLensFinding(finding);
    residuals_.Set({problem->camera, finding.residual});
  }
  const auto lacking = residuals_.FindLacking(mapper->map());
  if (!lacking) return;
  const Status taken = mapper->TakeResidual(*lacking, AdaptToResidual(mapper->map(), *lacking, nullptr));
  PORTOLAN_CHECK(taken.ok()) << taken.error().message;
}

void Pipeline::CloseLoops(LocalMapper* mapper, MapperState state) {
  const std::atomic<bool> go_on{false};
  const auto tell = [&] {
    state.epoch = mapper->map().epoch();
    state.revision = mapper->map().revision();
    loop_closer_.OnMapperState(state);
    while (loop_closer_.Update()) {
    }
  };
  tell();
  while (const auto job = loop_closer_.NextJob()) {
    loop_closer_.OnJobDone((*job)(go_on));
    const auto correction = loop_closer_.TakeCorrection();
    if (!correction) continue;
    const Status applied = mapper->ApplyCorrection(*correction);
    state.correction_process = correction->process;
    state.correction_number = correction->number;
    state.correction_refusal = applied ? "" : applied.error().message;
    tell();
  }
}

}  // namespace portolan
