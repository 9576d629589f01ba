#include "process/mapper_process.h"

#include <algorithm>
#include <utility>

#include "messages/limits.h"
#include "process/held_bytes.h"
#include "process/process_report.h"

namespace portolan {
namespace {

constexpr double kStatusPeriodS = 1.0;
constexpr double kTickPeriodS = 0.15;    // well within the liveliness lease of 500 ms
constexpr int kBackgroundNiceSteps = 4;  // behind the mapping, as loop_closer is

}  // namespace

MapperProcess::MapperProcess(const ProcessSetup& setup, const MapperOptions& options, uint64_t vocabulary_hash,
                             Bus* bus, const std::string& priority, ProcessLoop* loop)
    : setup_(setup),
      options_(options),
      vocabulary_hash_(vocabulary_hash),
      bus_(bus),
      priority_(priority),
      loop_(loop),
      status_(bus, setup, priority),
      delta_writer_(bus->CreateWriter<MapDeltaChunk>()),
      keyframe_writer_(bus->CreateWriter<KeyFrameMessage>()),
      state_writer_(bus->CreateWriter<MapperState>()),
      request_writer_(bus->CreateWriter<Request>()),
      snapshot_writer_(bus->CreateWriter<SnapshotRequest>()),
      snapshots_(
          keyframe_writer_.get(), delta_writer_.get(), vocabulary_hash,
          [this](MapId map) {
            const auto mapper = mappers_.find(map);
            return mapper == mappers_.end() ? nullptr : &mapper->second->map();
          },
          [](const KeyFrameData& data) { return Result<KeyFrameData>(data); }),
      point_ids_(setup.options.robot, setup.session),
      request_ids_(setup.options.robot, setup.session),
      is_standby_(setup.options.standby),
      warm_maps_(setup.process),
      background_(loop, kBackgroundNiceSteps) {
  state_.process = setup.process;
}

MapperProcess::~MapperProcess() {
  readers_.clear();
}

/// Whether what a robot's tracker says of a map may be for this mapper: of its own robot, or of another that is in a
/// map which its own began. For the readers' threads, which don't know what it owns.
bool MapperProcess::Concerns(RobotId robot, MapId map) const {
  return robot == setup_.options.robot || map.robot() == setup_.options.robot;
}

void MapperProcess::ConnectReaders() {
  readers_.push_back(bus_->CreateReader<KeyFrameMessage>([this](KeyFrameMessage message) {
    if (message.kind == KeyFrameKind::kQuery) return;  // the atlas_server's
    // Another robot's, in another's map, is no work that tracking waits for.
    const bool is_mine = Concerns(message.data.id.robot(), message.map);
    const int waits = message.kind == KeyFrameKind::kCopy || !is_mine ? 0 : 1;
    const auto received = Clock::now();
    const size_t held_bytes = HeldBytes(message);
    keyframes_waiting_ += waits;
    const bool is_queued = loop_->Post(
        [this, message = std::move(message), received, waits] {
          keyframes_waiting_ -= waits;
          process_times_.Add("queue_wait", std::chrono::duration<double, std::milli>(Clock::now() - received).count());
          OnKeyFrame(message);
          TellIdle();
        },
        held_bytes);
    if (!is_queued) keyframes_waiting_ -= waits;  // the tracker sends it again
  }));
  // The paper's signal "stop the time-consuming map optimization" (Sec. 3.3): beside the queue, or it would wait for
  // what it is to stop.
  readers_.push_back(bus_->CreateReader<TrackerState>([this](TrackerState state) {
    if (state.interrupt_mapper && Concerns(state.process.robot(), state.map)) stop_optimisation_ = true;
  }));
  const auto post = [this](auto handle) {
    return [this, handle](auto message) {
      const size_t held_bytes = HeldBytes(message);
      loop_->Post([this, handle, message = std::move(message)] { (this->*handle)(message); }, held_bytes);
    };
  };
  readers_.push_back(bus_->CreateReader<Command>(post(&MapperProcess::OnCommand)));
  readers_.push_back(bus_->CreateReader<SnapshotRequest>(post(&MapperProcess::OnSnapshotRequest)));
  readers_.push_back(bus_->CreateReader<Reply>(post(&MapperProcess::OnReply)));
  readers_.push_back(bus_->CreateReader<MapDeltaChunk>(post(&MapperProcess::OnDeltaChunk)));
  readers_.push_back(bus_->CreateReader<MapCorrection>(post(&MapperProcess::OnCorrection)));
  if (is_standby_) {
    readers_.push_back(bus_->CreateReader<MapperState>([this](MapperState state) {
      loop_->Post([this, state = std::move(state)] {
        if (is_standby_) warm_maps_.OnMapperState(state);
      });
    }));
  }
}

int MapperProcess::Run() {
  ConnectReaders();
  Register();
  loop_->AddTimer(kStatusPeriodS, [this] { OnStatusTimer(); });
  loop_->AddTimer(kTickPeriodS, [this] { OnTick(); });
  OnStatusTimer();
  loop_->Run();
  readers_.clear();
  nlohmann::json report = MakeReport(
      setup_.options, priority_,
      [&] {
        StageTimes times = process_times_;
        for (const auto& [map, mapper] : mappers_) KeepTimes(*mapper, &times);
        return times;
      }(),
      *bus_);
  report["keyframes_taken"] = taken_;
  report["keyframes_refused"] = refused_;
  report["keyframes_repeated"] = repeated_;
  report["events_dropped"] = loop_->dropped();
  report["interrupts"] = interrupts_;
  report["fusions"] = fusions_;
  if (Status written = WriteReport(setup_.options, report); !written) {
    spdlog::error("{}", written.error().message);
    return kExitFailure;
  }
  return exit_code_;
}

void MapperProcess::Register() {
  Request request;
  request.id = request_ids_.Next();
  request.sender = setup_.process;
  request.kind = "register_mapper";
  if (is_standby_) request.argument = kStandbyState;
  registration_ = request;
}

void MapperProcess::OnReply(const Reply& reply) {
  if (!registration_ || reply.id != registration_->id) return;
  registration_.reset();
  if (reply.ok) return;
  spdlog::error("the atlas_server refused this mapper: {}", reply.reason);
  exit_code_ = kExitRefused;
  loop_->Stop();
}

void MapperProcess::OnCommand(const Command& command) {
  const bool is_mine = command.robot == setup_.options.robot;
  warm_maps_.OnCommand(command);
  switch (command.kind) {
    case CommandKind::kGrantOwnership:
      return command.owner == setup_.process ? Own(command.map, command.epoch) : PassOn(command.map, command.epoch);
    case CommandKind::kFuseMaps:
      return Forget(command.other);  // its owner was this one, or another's mapper
    case CommandKind::kForgetMap:
      return Forget(command.map);
    case CommandKind::kDrain:
      return OnDrain(command.owner);
    case CommandKind::kAppointMapper:
      if (is_mine) OnAppointment(command.owner);
      return;
    default:
      return;  // of others
  }
}

void MapperProcess::OnKeyFrame(KeyFrameMessage message) {
  if (message.vocabulary_hash != vocabulary_hash_) {
    if (foreign_vocabulary_++ == 0)
      spdlog::error("keyframes made with another vocabulary ({:016x}, here {:016x}) are passed over",
                    message.vocabulary_hash, vocabulary_hash_);
    return;
  }
  if (message.kind == KeyFrameKind::kCopy) return OnCopy(message);
  if (is_standby_) return warm_maps_.AddKeyFrame(message.map, message.data);
  if (IsDrained()) return;  // for who comes after: the tracker sends it again
  fused_.Redirect(
      [this](MapId map) {
        const auto found = mappers_.find(map);
        return found == mappers_.end() ? nullptr : &found->second->map();
      },
      &message);
  const auto mapper = mappers_.find(message.map);
  if (mapper != mappers_.end()) {
    Take(mapper->second.get(), message);
  } else {
    WaitForGrant(std::move(message));
  }
}

void MapperProcess::Take(LocalMapper* mapper, const KeyFrameMessage& message) {
  state_.map = message.map;
  state_.epoch = mapper->map().epoch();
  state_.revision = mapper->map().revision();
  stop_optimisation_ = false;
  PublishState(false);
  auto data = MakeKeyFrameData(message.data, nullptr);  // mapping asks for no words
  const KeyFrameId id = data->id;
  const bool known = mapper->HasHad(id);  // sent again: the acknowledgement was lost or is on its way
  Status taken = known ? Status(Ok{}) : TakeIntoMap(mapper, std::move(data), message);
  if (stop_optimisation_) ++interrupts_;
  if (known) {
    ++repeated_;
  } else if (taken) {
    ++taken_;
  } else {
    ++refused_;
    spdlog::debug("keyframe {} refused: {}", ToString(id), taken.error().message);
    state_.refused_keyframe = id;
    state_.refusal = taken.error().message;
  }
  state_.last_keyframe = id;
  state_.epoch = mapper->map().epoch();
  state_.revision = mapper->map().revision();
  RefineLens(message.map, mapper);
  PublishState(keyframes_waiting_ == 0);
}

void MapperProcess::RefineLens(MapId map, LocalMapper* mapper) {
  if (background_.busy() || draining_.IsValid()) return;
  if (const auto lacking = residuals_.FindLacking(mapper->map())) return AdaptMap(mapper->map(), *lacking);
  if (!options_.lens.enabled) return;
  auto problem = mapper->NextLensProblem();
  if (!problem) return;
  state_.is_refining = true;
  background_.Start([this, map, epoch = mapper->map().epoch(), problem = std::move(*problem),
                     options = options_.lens](const std::atomic<bool>&) {
    const LensFinding finding = FindRadialResidual(problem, options);
    return [this, map, epoch, camera = problem.camera, finding] { OnLensFinding(map, epoch, camera, finding); };
  });
}

void MapperProcess::OnLensFinding(MapId map, Epoch epoch, const PinholeCamera& camera, const LensFinding& finding) {
  state_.is_refining = false;
  const auto mapper = mappers_.find(map);
  if (mapper != mappers_.end() && mapper->second->map().epoch() == epoch) {
    mapper->second->TakeLensFinding(finding);
    residuals_.Set({camera, finding.residual});
    const auto lacking = residuals_.FindLacking(mapper->second->map());
    if (lacking) AdaptMap(mapper->second->map(), *lacking);
  }
  PublishState(keyframes_waiting_ == 0);
}

void MapperProcess::AdaptMap(const Map& map, const CameraResidual& known) {
  state_.is_refining = true;
  background_.Start([this, map, known](const std::atomic<bool>& stop) {
    const MapCorrection adaptation = AdaptToResidual(map, known, &stop);
    return [this, known, adaptation] { OnAdapted(known, adaptation); };
  });
}

void MapperProcess::OnAdapted(const CameraResidual& known, const MapCorrection& adaptation) {
  state_.is_refining = false;
  const auto mapper = mappers_.find(adaptation.map);
  if (mapper != mappers_.end()) {
    const Status taken = mapper->second->TakeResidual(known, adaptation);
    // AdaptMaps tries again.
    if (!taken) spdlog::info("lens: not taken out of map {} yet: {}", ToString(adaptation.map), taken.error().message);
    if (adaptation.map == state_.map) state_.revision = mapper->second->map().revision();
  }
  PublishState(keyframes_waiting_ == 0);
}

/// Also of maps that get no keyframes: what was found in one is taken out of those that are to become one with it, too.
void MapperProcess::AdaptMaps() {
  if (background_.busy() || draining_.IsValid()) return;
  for (const auto& [id, mapper] : mappers_) {
    const auto lacking = residuals_.FindLacking(mapper->map());
    if (!lacking) continue;
    AdaptMap(mapper->map(), *lacking);
    return PublishState(keyframes_waiting_ == 0);
  }
}

Status MapperProcess::TakeIntoMap(LocalMapper* mapper, std::shared_ptr<const KeyFrameData> data,
                                  const KeyFrameMessage& message) {
  if (message.kind == KeyFrameKind::kInitialFirst) {
    firsts_.clear();
    firsts_[data->id] = std::move(data);
    return Ok{};
  }
  if (message.kind == KeyFrameKind::kInitialSecond) {
    const auto first = firsts_.find(message.reference);
    if (first == firsts_.end())
      return Error{"the first keyframe of the pair, " + ToString(message.reference) + ", is not here"};
    return mapper->Initialize(first->second, std::move(data), message);
  }
  return mapper->Process(
      std::move(data), message, [this] { return keyframes_waiting_ > 0 || stop_optimisation_; }, &stop_optimisation_);
}

void MapperProcess::PublishDelta(const MapDelta& delta) {
  for (const MapDeltaChunk& chunk : SplitDelta(delta, kDeltaChunkElements)) delta_writer_->Write(chunk);
  status_.AssertLiveliness();
}

void MapperProcess::PublishState(bool idle) {
  state_.idle = idle;
  state_.queue_depth = static_cast<uint32_t>(std::max(0, keyframes_waiting_.load()));
  state_writer_->Write(state_);
}

/// The last keyframe taken in left others waiting, and none of them was work.
void MapperProcess::TellIdle() {
  const bool seems_busy = state_.map.IsValid() && !state_.idle && !is_standby_ && !IsDrained();
  if (seems_busy && keyframes_waiting_ == 0) PublishState(true);
}

void MapperProcess::OnSnapshotRequest(const SnapshotRequest& request) {
  if (mappers_.count(request.map) == 0 || request.asker == setup_.process) return;
  snapshots_.Add(request);
  if (!snapshots_go_on_) SendSnapshots();
}

/// A piece at a time: keyframes that wait behind it get their turn.
void MapperProcess::SendSnapshots() {
  snapshots_go_on_ = snapshots_.SendPiece(std::chrono::duration<double>(Clock::now().time_since_epoch()).count()) &&
                     loop_->Post([this] { SendSnapshots(); });
  status_.AssertLiveliness();
}

void MapperProcess::OnCorrection(const MapCorrection& correction) {
  const auto mapper = mappers_.find(correction.map);
  if (mapper == mappers_.end()) return;
  const Status applied = IsDrained()                   ? Status(Error{"the map is about to pass on to another mapper"})
                         : correction.kind == "fusion" ? Fuse(correction)
                                                       : mapper->second->ApplyCorrection(correction);
  if (applied) {
    ++corrections_;
  } else {
    spdlog::warn("correction {} of {} refused: {}", correction.number, ToString(correction.process),
                 applied.error().message);
  }
  state_.correction_process = correction.process;
  state_.correction_number = correction.number;
  state_.correction_refusal = applied ? "" : applied.error().message;
  state_.map = correction.map;
  state_.epoch = mapper->second->map().epoch();
  state_.revision = mapper->second->map().revision();
  PublishState(keyframes_waiting_ == 0);
}

void MapperProcess::OnTick() {
  status_.AssertLiveliness();
  TellIdle();  // a keyframe may have been lost to a full queue
  ContinueTakeovers();
  FollowOwner();
  ContinueDrain();
  if (!snapshots_go_on_ && !snapshots_.IsIdle()) SendSnapshots();
}

void MapperProcess::OnStatusTimer() {
  if (registration_) request_writer_->Write(*registration_);
  AdaptMaps();
  if (IsDrained()) TellAllHeld();
  // Of what it follows, if it owns nothing.
  const Map* followed = is_standby_ && mappers_.empty() ? warm_maps_.current() : nullptr;
  status_.Publish(StateInWords(), followed != nullptr ? followed->id() : state_.map,
                  followed != nullptr ? followed->epoch() : state_.epoch,
                  followed != nullptr ? followed->revision() : state_.revision,
                  {{"keyframes_taken", static_cast<double>(taken_)},
                   {"keyframes_refused", static_cast<double>(refused_)},
                   {"keyframes_repeated", static_cast<double>(repeated_)},
                   {"keyframes_waiting", static_cast<double>(keyframes_waiting_)},
                   {"early_dropped", static_cast<double>(early_dropped_)},
                   {"foreign_vocabulary", static_cast<double>(foreign_vocabulary_)},
                   {"interrupts", static_cast<double>(interrupts_)},
                   {"corrections", static_cast<double>(corrections_)},
                   {"fusions", static_cast<double>(fusions_)},
                   {"maps", static_cast<double>(mappers_.size())},
                   {"keyframes", static_cast<double>(NumKeyFrames())},
                   {"maps_followed", static_cast<double>(warm_maps_.num_maps())},
                   {"maps_missing", static_cast<double>(warm_maps_.num_missing())},
                   {"lag", static_cast<double>(warm_maps_.Lag())},
                   {"events_dropped", static_cast<double>(loop_->dropped())}});
}

}  // namespace portolan
