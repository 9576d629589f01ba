#include "process/frontend_process.h"

#include <unistd.h>

#include <cstdio>
#include <utility>

#include "base/hash.h"

#include "process/process_report.h"
#include "process/run_output.h"

namespace portolan {
namespace {

constexpr double kStatusPeriodS = 1.0;
constexpr double kTickPeriodS = 0.1;
constexpr auto kResendAfter = std::chrono::seconds(2);           // many times what a mapper takes for a keyframe
constexpr auto kSnapshotRequestInterval = std::chrono::seconds(1);
constexpr auto kLoopPatience = std::chrono::seconds(3);  // the loop_closer repeats its state once a second
constexpr auto kProgressInterval = std::chrono::milliseconds(500);

const char* InWords(TrackingState state) {
  switch (state) {
    case TrackingState::kInitializing: return "initializing";
    case TrackingState::kTracking: return "tracking";
    case TrackingState::kRelocalizing: return "relocalizing";
    case TrackingState::kLost: return "lost, making a new map";
  }
  return "";
}

double MillisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

FrontendProcess::FrontendProcess(const ProcessSetup& setup, const FrontendOptions& options, std::unique_ptr<Player> player,
                                 std::shared_ptr<const Vocabulary> vocabulary, Bus* bus, const std::string& priority, ProcessLoop* loop)
    : setup_(setup),
      options_(options),
      bus_(bus),
      loop_(loop),
      player_(std::move(player)),
      vocabulary_(std::move(vocabulary)),
      priority_(priority),
      tracker_(options.tracker, player_->camera(), vocabulary_, setup.options.robot, setup.session),
      pump_(
          player_.get(),
          [this](PlayedFrame frame) { return loop_->Post([this, frame = std::move(frame)] { OnFrame(frame); }); },
          [this] { loop_->Post([this] { OnEndOfSource(); }); }),
      status_(bus, setup, priority),
      keyframe_writer_(bus->CreateWriter<KeyFrameMessage>()),
      state_writer_(bus->CreateWriter<TrackerState>()),
      snapshot_writer_(bus->CreateWriter<SnapshotRequest>()),
      request_writer_(bus->CreateWriter<Request>()),
      request_ids_(setup.options.robot, setup.session) {}

FrontendProcess::~FrontendProcess() {
  readers_.clear();  // before what their handlers use
  pump_.Stop();
}

void FrontendProcess::ConnectReaders() {
  readers_.push_back(bus_->CreateReader<MapDeltaChunk>([this](MapDeltaChunk chunk) {
    loop_->Post([this, chunk = std::move(chunk)] { OnDeltaChunk(chunk); });
  }));
  readers_.push_back(bus_->CreateReader<MapperState>([this](MapperState state) {
    loop_->Post([this, state = std::move(state)] { OnMapper(state); });
  }));
  readers_.push_back(bus_->CreateReader<FollowerState>([this](FollowerState state) {
    if (state.process.robot() != setup_.options.robot) return;
    loop_->Post([this, state] {
      loop_state_ = state;
      loop_heard_ = Clock::now();
      ReleasePumpIfReady();
    });
  }));
  readers_.push_back(bus_->CreateReader<KeyFrameMessage>([this](KeyFrameMessage message) {
    if (message.kind != KeyFrameKind::kCopy || message.vocabulary_hash != vocabulary_->hash()) return;
    auto data = MakeKeyFrameData(std::move(message.data), vocabulary_.get());
    loop_->Post([this, data = std::move(data)] { tracker_.AddKeyFrameData(data); });
  }));
  readers_.push_back(bus_->CreateReader<Reply>([this](Reply reply) {
    loop_->Post([this, reply = std::move(reply)] {
      if (open_requests_.erase(reply.id) == 1 && !reply.ok) spdlog::warn("request refused: {}", reply.reason);
    });
  }));
  readers_.push_back(bus_->CreateReader<ProcessStatus>([this](ProcessStatus status) {
    if (status.process.robot() != setup_.options.robot && status.role != "atlas_server") return;
    loop_->Post([this, role = status.role] { roles_seen_.insert(role); });
  }));
}

int FrontendProcess::Run() {
  ConnectReaders();
  loop_->AddTimer(kStatusPeriodS, [this] { OnStatusTimer(); });
  loop_->AddTimer(kTickPeriodS, [this] { OnTick(); });
  const int signal = loop_->Run();
  if (signal != 0) {
    spdlog::info("stopped by the user");
    exit_code_ = kExitInterrupted;
  }
  pump_.Stop();
  const int written = Finish();
  return exit_code_ != kExitOk ? exit_code_ : written;
}

void FrontendProcess::CheckPeers() {
  const size_t others = roles_seen_.count("backend_mapper") + roles_seen_.count("loop_closer") + roles_seen_.count("atlas_server");
  const bool ready = roles_seen_.count("backend_mapper") == 1 && roles_seen_.count("atlas_server") == 1 &&
                     keyframe_writer_->MatchedReaders() >= static_cast<int>(others) && request_writer_->MatchedReaders() >= 1 &&
                     (roles_seen_.count("loop_closer") == 0 || loop_state_.process.IsValid());
  if (ready) {
    spdlog::info("backend_mapper and atlas_server are there; starting");
    phase_ = Phase::kRunning;
    pump_.Start();
    return;
  }
  if (MillisecondsSince(phase_start_) < options_.peer_timeout_s * 1e3) return;
  for (const char* role : {"backend_mapper", "atlas_server"}) {
    if (roles_seen_.count(role) == 0) {
      spdlog::error("no {} of robot {} in domain {} within {} s: is it running, with the same --domain and --robot, and reachable?", role,
                    setup_.options.robot, setup_.options.bus.domain, options_.peer_timeout_s);
    }
  }
  exit_code_ = kExitUnreachable;
  phase_ = Phase::kOver;
  loop_->Stop();
}

void FrontendProcess::OnFrame(PlayedFrame frame) {
  frame_in_work_ = true;
  ++frames_;
  const Tracker::Output output = tracker_.Track(frame.image);
  process_times_.Add("wait", MillisecondsSince(frame.available) - output.state.frame_ms);
  Publish(output);
  last_state_ = output.state;
  spdlog::debug("frame {}: {}, {} of {} points, {} keyframes sent, {:.1f} ms", output.state.frame, InWords(output.state.state), output.state.num_inliers,
                output.state.num_candidates, output.keyframes.size(), output.state.frame_ms);
  if (output.state.state == TrackingState::kTracking) ++tracked_online_;
  status_.AssertLiveliness();
  ShowProgress(output.state);
  ReleasePumpIfReady();
}

void FrontendProcess::Publish(const Tracker::Output& output) {
  for (const MapId map : output.new_maps) {
    Request request;
    request.id = request_ids_.Next();
    request.sender = setup_.process;
    request.kind = "new_map";
    request.map = map;
    open_requests_[request.id] = request;
    request_writer_->Write(request);
  }
  for (const KeyFrameMessage& message : output.keyframes) {
    published_[message.data.id] = Clock::now();
    keyframe_writer_->Write(message);
    last_send_ = Clock::now();
  }
  TrackerState state = output.state;
  state.process = setup_.process;
  state_writer_->Write(state);
}

void FrontendProcess::OnDeltaChunk(MapDeltaChunk chunk) {
  for (MapDelta& delta : assembler_.Add(std::move(chunk))) {
    for (const MapDelta::KeyFrameState& keyframe : delta.keyframes) {
      const auto sent = published_.find(keyframe.id);
      if (sent == published_.end()) continue;
      process_times_.Add("keyframe_to_delta", MillisecondsSince(sent->second));
      published_.erase(sent);
    }
    tracker_.AddDelta(std::move(delta));
  }
  // Between frames nothing is urgent: apply at once what came, so that the next frame need not.
  if (!frame_in_work_ || options_.playback.mode == PlaybackMode::kLockstep) tracker_.ApplyPending();
  ReleasePumpIfReady();
}

void FrontendProcess::OnMapper(const MapperState& state) {
  const bool new_mapper = mapper_.process.IsValid() && mapper_.process != state.process;
  mapper_ = state;
  tracker_.OnMapperState(state);
  if (state.refused_keyframe.IsValid() && state.refused_keyframe == state.last_keyframe) spdlog::debug("mapper refused {}: {}", ToString(state.refused_keyframe), state.refusal);
  if (new_mapper) {
    for (const KeyFrameMessage& message : tracker_.UnacknowledgedKeyFrames()) keyframe_writer_->Write(message);
  }
  ReleasePumpIfReady();
}

bool FrontendProcess::MapperIsDone() const {
  if (tracker_.AwaitedKeyFrame() || mapper_.is_refining) return false;
  const auto replica = tracker_.replicas().find(mapper_.map);
  return replica == tracker_.replicas().end() || replica->second.map().revision() >= mapper_.revision;
}

bool FrontendProcess::LoopIsDone() const {
  if (!loop_state_.process.IsValid() || Clock::now() - loop_heard_ > kLoopPatience) return true;  // there is none, or none any more
  if (!loop_state_.last_keyframe.IsValid()) return true;  // it came in between, and is told of the next keyframe
  return !loop_state_.is_busy && loop_state_.last_keyframe == mapper_.last_keyframe;
}

void FrontendProcess::ReleasePumpIfReady() {
  if (phase_ == Phase::kDraining) {
    if (MapperIsDone() && LoopIsDone()) {  // a loop found with the last frames is in the map too
      phase_ = Phase::kOver;
      loop_->Stop();
    }
    return;
  }
  if (!frame_in_work_) return;
  if (options_.playback.mode == PlaybackMode::kLockstep && !(MapperIsDone() && LoopIsDone())) return;
  frame_in_work_ = false;
  pump_.Done();
}

void FrontendProcess::OnEndOfSource() {
  phase_ = Phase::kDraining;
  phase_start_ = Clock::now();
  ReleasePumpIfReady();
}

void FrontendProcess::OnTick() {
  status_.AssertLiveliness();
  if (phase_ == Phase::kWaitingForPeers) CheckPeers();
  if (phase_ == Phase::kRunning) ReleasePumpIfReady();
  const auto now = Clock::now();
  if (tracker_.AwaitedKeyFrame() && now - last_send_ > kResendAfter) {
    spdlog::debug("the mapper has not answered: sending {} keyframes again", tracker_.num_unacknowledged());
    for (const KeyFrameMessage& message : tracker_.UnacknowledgedKeyFrames()) keyframe_writer_->Write(message);
    for (const auto& [id, request] : open_requests_) request_writer_->Write(request);
    last_send_ = now;
  }
  const auto in_need = tracker_.ReplicasInNeed();
  if (in_need.empty()) {
    in_need_since_.reset();
  } else if (!in_need_since_) {
    in_need_since_ = now;
  } else if (now - *in_need_since_ > std::chrono::milliseconds(MapReplica::kPatienceMs) && now - last_snapshot_request_ > kSnapshotRequestInterval) {
    for (const MapReplica* replica : in_need) {
      spdlog::debug("asking for a snapshot of map {}: {}", ToString(replica->map().id()), replica->last_problem());
      snapshot_writer_->Write(replica->MakeRequest(setup_.process));
    }
    last_snapshot_request_ = now;
  }
  if (phase_ == Phase::kDraining && MillisecondsSince(phase_start_) > options_.peer_timeout_s * 1e3) {
    spdlog::warn("mapper and loop_closer did not finish within {} s of the last frame", options_.peer_timeout_s);
    phase_ = Phase::kOver;
    loop_->Stop();
  }
}

void FrontendProcess::OnStatusTimer() {
  Revision revision = 0;
  Epoch epoch = 0;
  if (tracker_.active_map().IsValid()) {
    const Map& map = tracker_.replicas().at(tracker_.active_map()).map();
    revision = map.revision();
    epoch = map.epoch();
  }
  const PlaybackReport playback = player_->report();
  status_.Publish(phase_ == Phase::kWaitingForPeers ? "waiting for peers" : InWords(tracker_.state()), tracker_.active_map(), epoch, revision,
                  {{"frames", static_cast<double>(frames_)},
                   {"tracked", static_cast<double>(tracked_online_)},
                   {"frames_dropped", static_cast<double>(playback.dropped)},
                   {"frames_unreadable", static_cast<double>(playback.unreadable)},
                   {"events_waiting", static_cast<double>(loop_->depth())},
                   {"events_dropped", static_cast<double>(loop_->dropped())},
                   {"unacknowledged_keyframes", static_cast<double>(tracker_.num_unacknowledged())}});
}

void FrontendProcess::ShowProgress(const TrackerState& state) {
  if (Clock::now() - last_progress_ < kProgressInterval) return;
  last_progress_ = Clock::now();
  size_t keyframes = 0, points = 0;
  for (const auto& [id, replica] : tracker_.replicas()) {
    keyframes += replica.map().keyframes().size();
    points += replica.map().points().size();
  }
  std::printf("%sframe %llu  %-22s  %4u of %4u points  %4zu keyframes  %6zu landmarks  %5.1f ms  dropped %llu%s", isatty(1) ? "\r" : "",
              static_cast<unsigned long long>(state.frame), InWords(state.state), state.num_inliers, state.num_candidates, keyframes, points,
              static_cast<double>(state.frame_ms), static_cast<unsigned long long>(player_->report().dropped), isatty(1) ? "   " : "\n");
  std::fflush(stdout);
}

int FrontendProcess::Finish() {
  if (isatty(1)) std::printf("\n");
  tracker_.ApplyPending();
  tracker_.FinishBackfill();
  const RunTrajectories trajectories = MakeTrajectories(tracker_.history(), tracker_.replicas());
  const PlaybackReport playback = player_->report();
  for (const std::string& message : playback.messages) spdlog::warn("{}", message);
  StageTimes times = tracker_.stage_times();
  for (const auto& [stage, samples] : process_times_.samples()) {
    for (const double sample : samples) times.Add(stage, sample);
  }
  nlohmann::json report = MakeReport(setup_.options, priority_, times, *bus_);
  size_t keyframes = 0, points = 0;
  for (const auto& [map, number] : trajectories.map_numbers) {
    keyframes += tracker_.replicas().at(map).map().keyframes().size();
    points += tracker_.replicas().at(map).map().points().size();
  }
  const uint64_t frames = playback.delivered + playback.dropped + playback.unreadable;
  report["frames"] = frames;
  report["tracked"] = trajectories.joined.size();
  report["tracked_online"] = trajectories.online.size();
  report["lost"] = frames - std::min<uint64_t>(frames, trajectories.joined.size());
  report["dropped"] = playback.dropped;
  report["unreadable"] = playback.unreadable;
  report["maps"] = trajectories.map_numbers.size();
  report["keyframes"] = keyframes;
  report["keyframes_sent"] = tracker_.num_keyframes_sent();
  report["points"] = points;
  for (const auto& [map, number] : trajectories.map_numbers) {
    report["map_hash"][ToString(map)] = FormatHash(HashMap(tracker_.replicas().at(map).map()));
  }
  const RadialResidual& residual = tracker_.camera().residual;
  report["lens_residual"] = {residual.k1, residual.k2};
  report["switches"] = 0;
  report["fusions"] = 0;
  const auto& frame_times = times.samples().find("frame");
  report["frame_ms"] = SummarizeTimes(frame_times == times.samples().end() ? std::vector<double>() : frame_times->second);
  if (setup_.options.out.empty()) return kExitOk;
  Status written = WriteRunOutput(setup_.options.out, trajectories, tracker_.replicas());
  if (written) written = WriteReport(setup_.options, report);
  if (written) return kExitOk;
  spdlog::error("{}", written.error().message);
  return kExitFailure;
}

}  // namespace portolan
