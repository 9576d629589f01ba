#include "process/frontend_process.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "base/hash.h"
#include "process/held_bytes.h"
#include "process/process_report.h"
#include "process/run_output.h"

namespace portolan {
namespace {

constexpr double kStatusPeriodS = 1.0;
constexpr double kTickPeriodS = 0.1;
constexpr auto kRequestPatience = std::chrono::seconds(2);
// For an answer to a keyframe, before the next urgent one is made without it.
constexpr auto kMapperPatience = std::chrono::seconds(1);
constexpr auto kSnapshotRequestInterval = std::chrono::seconds(1);
constexpr auto kAtlasPatience = std::chrono::seconds(2);  // for an answer that nothing depends on
constexpr auto kMapPatience = std::chrono::seconds(5);    // of a lockstep run, for a map that the tracker is to go into
constexpr size_t kMaxUnnamed = 256;                       // keyframes of other robots that no delta has named yet
constexpr auto kProgressInterval = std::chrono::milliseconds(500);

const char* InWords(TrackingState state) {
  switch (state) {
    case TrackingState::kInitializing:
      return "initializing";
    case TrackingState::kTracking:
      return "tracking";
    case TrackingState::kRelocalizing:
      return "relocalizing";
    case TrackingState::kLost:
      return "lost";
  }
  return "";
}

double SecondsNow() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// For one robot now, unlike a fact: one that was given before this process began is not for it.
bool IsOrder(const Command& command) {
  switch (command.kind) {
    case CommandKind::kActivateMap:
      return !command.other.IsValid();
    case CommandKind::kNewMap:
    case CommandKind::kPause:
    case CommandKind::kResume:
    case CommandKind::kLocalizeOnly:
    case CommandKind::kMapAgain:
      return true;
    default:
      return false;
  }
}

double MillisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

FrontendProcess::FrontendProcess(const ProcessSetup& setup, const FrontendOptions& options,
                                 std::unique_ptr<Player> player, RunSoFar so_far,
                                 std::shared_ptr<const Vocabulary> vocabulary, Bus* bus, const std::string& priority,
                                 ProcessLoop* loop)
    : setup_(setup),
      options_(options),
      bus_(bus),
      loop_(loop),
      player_(std::move(player)),
      so_far_(std::move(so_far)),
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
      requests_(setup.process, setup.options.robot, setup.session, bus) {
  tracker_.Resume(so_far_.earlier_frames());
}

FrontendProcess::~FrontendProcess() {
  readers_.clear();  // before what their handlers use
  pump_.Stop();
}

void FrontendProcess::ConnectReaders() {
  readers_.push_back(bus_->CreateReader<MapDeltaChunk>([this](MapDeltaChunk chunk) {
    const size_t held_bytes = HeldBytes(chunk);
    loop_->Post([this, chunk = std::move(chunk)] { OnDeltaChunk(chunk); }, held_bytes);
  }));
  readers_.push_back(bus_->CreateReader<MapperState>(
      [this](MapperState state) { loop_->Post([this, state = std::move(state)] { OnMapper(state); }); }));
  readers_.push_back(bus_->CreateReader<FollowerState>([this](FollowerState state) {
    loop_->Post([this, state] {
      const bool is_mine = state.process.robot() == setup_.options.robot;
      const bool is_of_mine = state.last_keyframe.robot() == setup_.options.robot && state.last_keyframe.IsValid();
      const bool is_here = state.map.IsValid() && state.map == tracker_.active_map();
      if (!is_mine && !is_of_mine && !is_here) return;  // another robot's, in a map of its own
      loop_closer_is_ready_ = loop_closer_is_ready_ || is_mine;
      followers_.OnState(state, SecondsNow());
      ReleasePumpIfReady();
    });
  }));
  readers_.push_back(bus_->CreateReader<KeyFrameMessage>([this](KeyFrameMessage message) {
    const bool is_copy = message.kind == KeyFrameKind::kCopy;
    const bool is_others = message.data.id.robot() != setup_.options.robot && message.kind != KeyFrameKind::kQuery;
    if ((!is_copy && !is_others) || message.vocabulary_hash != vocabulary_->hash()) return;
    if (std::atomic_load(&followed_)->count(message.map) == 0) return;  // for somebody else
    const MapId map = message.map;
    const size_t held_bytes = HeldBytes(message);
    auto data = MakeKeyFrameData(std::move(message.data), vocabulary_.get());
    loop_->Post(
        [this, map, is_copy, data = std::move(data)] {
          if (is_copy || HasRoomForOthers(map)) tracker_.AddKeyFrameData(map, data);
        },
        held_bytes);
  }));
  readers_.push_back(
      bus_->CreateReader<Command>([this](Command command) { loop_->Post([this, command] { OnCommand(command); }); }));
  readers_.push_back(bus_->CreateReader<Reply>(
      [this](Reply reply) { loop_->Post([this, reply = std::move(reply)] { OnReply(reply); }); }));
  readers_.push_back(bus_->CreateReader<ProcessStatus>([this](ProcessStatus status) {
    if (status.process.robot() != setup_.options.robot && status.role != "atlas_server") return;
    loop_->Post([this, role = status.role] {
      roles_seen_.insert(role);
      if (role == "backend_mapper") resend_.OnMapperHeard(SecondsNow());
    });
  }));
}

/// Of robots that share the map: their keyframes come as they send them, before the delta that names them. What no
/// delta ever names fills no memory; what is missed so comes with a snapshot.
bool FrontendProcess::HasRoomForOthers(MapId map) const {
  const auto replica = tracker_.replicas().find(map);
  if (replica == tracker_.replicas().end()) return false;
  return replica->second.keyframe_data().size() < replica->second.map().keyframes().size() + kMaxUnnamed;
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
  const size_t others =
      roles_seen_.count("backend_mapper") + roles_seen_.count("loop_closer") + roles_seen_.count("atlas_server");
  const bool ready = roles_seen_.count("backend_mapper") == 1 && roles_seen_.count("atlas_server") == 1 &&
                     keyframe_writer_->MatchedReaders() >= static_cast<int>(others) &&
                     requests_.MatchedReaders() >= 1 &&
                     (roles_seen_.count("loop_closer") == 0 || loop_closer_is_ready_);
  if (ready) {
    AskAtlas();
    return;
  }
  if (MillisecondsSince(phase_start_) < options_.peer_timeout_s * 1e3) return;
  for (const char* role : {"backend_mapper", "atlas_server"}) {
    if (roles_seen_.count(role) == 0) {
      spdlog::error(
          "no {} of robot {} in domain {} within {} s: is it running, with the same --domain and --robot, and "
          "reachable?",
          role, setup_.options.robot, setup_.options.bus.domain, options_.peer_timeout_s);
    }
  }
  exit_code_ = kExitUnreachable;
  phase_ = Phase::kOver;
  loop_->Stop();
}

/// Whether the atlas holds maps that the camera may be in is known before the first frame, if the atlas_server answers
/// in time.
void FrontendProcess::AskAtlas() {
  phase_ = Phase::kAskingAtlas;
  phase_start_ = Clock::now();
  requests_.Send(tracker_.RequestFirstMap());
  NoteFollowedMaps();
  StartWhenAnswered();
}

void FrontendProcess::StartWhenAnswered() {
  if (!requests_.empty() && Clock::now() - phase_start_ < kAtlasPatience) return;
  spdlog::info("backend_mapper and atlas_server are there; starting");
  phase_ = Phase::kRunning;
  OnStatusTimer();  // it takes orders from now on
  pump_.Start();
}

void FrontendProcess::OnCommand(const Command& command) {
  if (IsOrder(command)) {
    if (!TakesOrders() || command.robot != setup_.options.robot) return;
    if (command.kind == CommandKind::kPause || command.kind == CommandKind::kResume)
      paused_ = command.kind == CommandKind::kPause;
  }
  tracker_.OnCommand(command);
  NoteFollowedMaps();
  AskForSnapshots();
  ReleasePumpIfReady();
  if (IsOrder(command)) OnStatusTimer();  // what may be ordered next depends on it
}

void FrontendProcess::OnReply(const Reply& reply) {
  const std::optional<Request> request = requests_.Close(reply);
  if (!request) return;
  tracker_.OnReply(*request, reply);
  if (phase_ == Phase::kAskingAtlas) StartWhenAnswered();
  ReleasePumpIfReady();
}

/// For the transport threads, which pass over what is of other maps.
void FrontendProcess::NoteFollowedMaps() {
  const auto& replicas = tracker_.replicas();
  const auto before = std::atomic_load(&followed_);
  if (before->size() == replicas.size() &&
      std::equal(before->begin(), before->end(), replicas.begin(),
                 [](MapId map, const auto& entry) { return map == entry.first; })) {
    return;
  }
  std::set<MapId> maps;
  for (const auto& [map, replica] : replicas) maps.insert(map);
  std::atomic_store(&followed_, std::make_shared<const std::set<MapId>>(std::move(maps)));
}

void FrontendProcess::OnFrame(PlayedFrame frame) {
  frame_in_work_ = true;
  ++frames_;
  if (player_->IsLive()) frame.image.frame += so_far_.frame_offset();
  tracker_.SetMapperSilent(tracker_.AwaitedKeyFrame() && Clock::now() - last_send_ > kMapperPatience);
  const Tracker::Output output = tracker_.Track(frame.image);
  process_times_.Add("wait", MillisecondsSince(frame.available) - output.state.frame_ms);
  Publish(output);
  last_state_ = output.state;
  spdlog::debug("frame {}: {}, {} of {} points, {} keyframes sent, {:.1f} ms", output.state.frame,
                InWords(output.state.state), output.state.num_inliers, output.state.num_candidates,
                output.keyframes.size(), output.state.frame_ms);
  if (output.state.state == TrackingState::kTracking) ++tracked_online_;
  status_.AssertLiveliness();
  so_far_.Note(player_->start(), tracker_.TakeChangedFrames());
  ShowProgress(output.state);
  ReleasePumpIfReady();
}

void FrontendProcess::Publish(const Tracker::Output& output) {
  for (const KeyFrameMessage& message : output.keyframes) {
    keyframe_writer_->Write(message);
    if (message.kind == KeyFrameKind::kQuery) continue;
    last_send_ = published_[message.data.id] = Clock::now();
    resend_.OnSent(message.data.id, SecondsNow());
  }
  requests_.Send(output.requests);
  NoteFollowedMaps();
  if (tracker_.active_map() != reported_map_) OnStatusTimer();  // who owns what depends on it
  TrackerState state = output.state;
  state.process = setup_.process;
  state_writer_->Write(state);
}

void FrontendProcess::SendAgain() {
  requests_.SendAgain(kRequestPatience);
  if (tracker_.unacknowledged().empty() || keyframe_writer_->MatchedReaders() == 0) return;
  std::vector<KeyFrameId> ids;
  for (const auto& [id, message] : tracker_.unacknowledged()) ids.push_back(id);
  const bool is_delivered = keyframe_writer_->WaitForAcknowledgments(0);
  const std::vector<KeyFrameId> due = resend_.Take(ids, tracker_.AwaitedKeyFrame(), is_delivered, SecondsNow());
  if (due.empty()) return;
  spdlog::debug("sending {} of {} unanswered keyframes again", due.size(), ids.size());
  for (const KeyFrameId id : due) keyframe_writer_->Write(tracker_.unacknowledged().at(id));
  sent_again_ += due.size();
}

void FrontendProcess::AskForSnapshots() {
  const auto now = Clock::now();
  const auto in_need = tracker_.ReplicasInNeed();
  if (in_need.empty()) in_need_since_.reset();
  if (!in_need.empty() && !in_need_since_) in_need_since_ = now;
  if (in_need.empty() || now - last_snapshot_request_ < kSnapshotRequestInterval) return;
  const bool is_patience_over = now - *in_need_since_ > std::chrono::milliseconds(MapReplica::kPatienceMs);
  for (const MapReplica* replica : in_need) {
    if (!is_patience_over && !tracker_.IsFresh(replica->map().id())) continue;
    spdlog::debug("asking for a snapshot of map {}: {}", ToString(replica->map().id()), replica->last_problem());
    snapshot_writer_->Write(replica->MakeRequest(setup_.process));
    last_snapshot_request_ = now;
  }
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
  if (!tracker_.OnMapperState(state)) return;
  if (mapper_.process.IsValid() && mapper_.process != state.process) resend_.OnNewMapper();
  resend_.OnMapperHeard(SecondsNow());
  mapper_ = state;
  if (state.refused_keyframe.IsValid() && state.refused_keyframe == state.last_keyframe)
    spdlog::debug("mapper refused {}: {}", ToString(state.refused_keyframe), state.refusal);
  ReleasePumpIfReady();
}

bool FrontendProcess::MapperIsDone() const {
  if (tracker_.AwaitedKeyFrame() || mapper_.is_refining) return false;
  const auto replica = tracker_.replicas().find(mapper_.map);
  return replica == tracker_.replicas().end() || replica->second.map().revision() >= mapper_.revision;
}

/// Of a lockstep run: whether the answer to a question or a map that was asked for is still to come.
bool FrontendProcess::IsWaitingForAtlas() const {
  if (requests_.HasAny("locate")) return true;
  if (!in_need_since_ || Clock::now() - *in_need_since_ > kMapPatience) return false;
  for (const MapReplica* replica : tracker_.ReplicasInNeed()) {
    if (tracker_.IsFresh(replica->map().id())) return true;
  }
  return false;
}

/// At the end of a resumed run: whether a map is still to come in which the earlier frontend had tracked frames.
bool FrontendProcess::IsWaitingForEarlierMaps() const {
  const auto& frames = so_far_.earlier_frames();
  return std::any_of(frames.begin(), frames.end(),
                     [&](const FrameRecord& frame) { return tracker_.IsFresh(frame.map); });
}

bool FrontendProcess::OthersAreDone() const {
  return MapperIsDone() && followers_.AreDone(mapper_.last_keyframe, SecondsNow());
}

void FrontendProcess::ReleasePumpIfReady() {
  if (phase_ == Phase::kDraining) {
    if (OthersAreDone() && !IsWaitingForEarlierMaps()) {  // a loop found with the last frames is in the map too
      phase_ = Phase::kOver;
      loop_->Stop();
    }
    return;
  }
  if (!frame_in_work_ || paused_) return;
  if (options_.playback.mode == PlaybackMode::kLockstep && (!OthersAreDone() || IsWaitingForAtlas())) return;
  frame_in_work_ = false;
  pump_.Done();
}

void FrontendProcess::OnEndOfSource() {
  if (options_.source.data == kTopicSource && frames_ + player_->report().unreadable == 0) {
    spdlog::error("no image on topic '{}' of domain {} within {} s: is it published there, and reachable?",
                  setup_.options.bus.image_topic, setup_.options.bus.domain, options_.topic.first_image_s);
    exit_code_ = kExitUnreachable;
  }
  phase_ = Phase::kDraining;
  phase_start_ = Clock::now();
  ReleasePumpIfReady();
}

void FrontendProcess::OnTick() {
  status_.AssertLiveliness();
  if (phase_ == Phase::kWaitingForPeers) CheckPeers();
  if (phase_ == Phase::kAskingAtlas) StartWhenAnswered();
  SendAgain();
  AskForSnapshots();
  if (phase_ == Phase::kRunning) ReleasePumpIfReady();
  if (phase_ == Phase::kDraining && MillisecondsSince(phase_start_) > options_.peer_timeout_s * 1e3) {
    spdlog::warn("mapper and loop_closer did not finish within {} s of the last frame", options_.peer_timeout_s);
    phase_ = Phase::kOver;
    loop_->Stop();
  }
}

std::string FrontendProcess::StateInWords() const {
  if (phase_ == Phase::kWaitingForPeers) return "waiting for peers";
  if (phase_ == Phase::kAskingAtlas) return "waiting for the atlas_server";
  std::string words = InWords(tracker_.state());
  const bool is_in_map =
      tracker_.state() == TrackingState::kTracking || tracker_.state() == TrackingState::kRelocalizing;
  if (is_in_map) words += " in map " + ToString(tracker_.active_map());
  if (tracker_.localization_only()) words += ", localization only";
  return paused_ ? "paused, " + words : words;
}

void FrontendProcess::OnStatusTimer() {
  reported_map_ = tracker_.active_map();
  Revision revision = 0;
  Epoch epoch = 0;
  if (tracker_.active_map().IsValid()) {
    const Map& map = tracker_.replicas().at(tracker_.active_map()).map();
    revision = map.revision();
    epoch = map.epoch();
  }
  const PlaybackReport playback = player_->report();
  const MapEvents& events = tracker_.map_events();
  status_.Publish(StateInWords(), tracker_.active_map(), epoch, revision,
                  {{"frames", static_cast<double>(frames_)},
                   {"tracked", static_cast<double>(tracked_online_)},
                   {"frames_dropped", static_cast<double>(playback.dropped)},
                   {"frames_unreadable", static_cast<double>(playback.unreadable)},
                   {"maps", static_cast<double>(tracker_.replicas().size())},
                   {"links", static_cast<double>(tracker_.links().num_links())},
                   {"takes_orders", TakesOrders() ? 1.0 : 0.0},
                   {"paused", paused_ ? 1.0 : 0.0},
                   {"localization_only", tracker_.localization_only() ? 1.0 : 0.0},
                   {"switches", static_cast<double>(events.switches)},
                   {"fusions", static_cast<double>(events.fusions)},
                   {"refused_moves", static_cast<double>(events.refusals)},
                   {"events_waiting", static_cast<double>(loop_->depth())},
                   {"events_dropped", static_cast<double>(loop_->dropped())},
                   {"unacknowledged_keyframes", static_cast<double>(tracker_.unacknowledged().size())},
                   {"keyframes_sent_again", static_cast<double>(sent_again_)},
                   {"keyframes_given_up", static_cast<double>(tracker_.num_given_up())}});
}

void FrontendProcess::ShowProgress(const TrackerState& state) {
  if (Clock::now() - last_progress_ < kProgressInterval) return;
  last_progress_ = Clock::now();
  size_t keyframes = 0, points = 0;
  for (const auto& [id, replica] : tracker_.replicas()) {
    keyframes += replica.map().keyframes().size();
    points += replica.map().points().size();
  }
  std::printf("%sframe %llu  %-22s  %4u of %4u points  %4zu keyframes  %6zu landmarks  %5.1f ms  dropped %llu%s",
              isatty(1) ? "\r" : "", static_cast<unsigned long long>(state.frame), InWords(state.state),
              state.num_inliers, state.num_candidates, keyframes, points, static_cast<double>(state.frame_ms),
              static_cast<unsigned long long>(player_->report().dropped), isatty(1) ? "   " : "\n");
  std::fflush(stdout);
}

void FrontendProcess::AddMapsTo(nlohmann::json* report, const RunTrajectories& trajectories) const {
  size_t keyframes = 0, points = 0;
  for (const auto& [id, number] : trajectories.map_numbers) {
    const Map& map = tracker_.replicas().at(id).map();
    keyframes += map.keyframes().size();
    points += map.points().size();
    (*report)["map_hash"][ToString(id)] = FormatHash(HashMap(map));
  }
  (*report)["maps"] = trajectories.map_numbers.size();
  (*report)["keyframes"] = keyframes;
  (*report)["points"] = points;
  (*report)["links"] = tracker_.links().num_links();
  (*report)["unlinked_maps"] = trajectories.unlinked_maps.size();
  const MapEvents& events = tracker_.map_events();
  (*report)["switches"] = events.switches;
  (*report)["fusions"] = events.fusions;
  (*report)["refused_moves"] = events.refusals;
  (*report)["frames_to_new_map"] = events.frames_to_new_map;
}

int FrontendProcess::Finish() {
  if (isatty(1)) std::printf("\n");
  tracker_.ApplyPending();
  tracker_.FinishHistory();
  const RunTrajectories trajectories = MakeTrajectories(tracker_.history(), tracker_.replicas(), tracker_.links());
  const PlaybackReport playback = player_->report();
  for (const std::string& message : playback.messages) spdlog::warn("{}", message);
  StageTimes times = tracker_.stage_times();
  for (const auto& [stage, samples] : process_times_.samples()) {
    for (const double sample : samples) times.Add(stage, sample);
  }
  nlohmann::json report = MakeReport(setup_.options, priority_, times, *bus_);
  const uint64_t earlier = player_->IsLive() ? so_far_.frame_offset() : playback.passed;
  const uint64_t frames = earlier + playback.delivered + playback.dropped + playback.unreadable;
  report["frames"] = frames;
  report["tracked"] = trajectories.joined.size();
  report["tracked_online"] = trajectories.online.size();
  report["lost"] = frames - std::min<uint64_t>(frames, trajectories.joined.size());
  report["dropped"] = playback.dropped;
  report["unreadable"] = playback.unreadable;
  report["keyframes_sent"] = tracker_.num_keyframes_sent();
  const TopicCounters keyframes = bus_->Counters()["keyframe"];
  if (keyframes.sent > 0) report["bytes_per_keyframe"] = keyframes.sent_bytes / keyframes.sent;
  report["keyframes_sent_again"] = sent_again_;
  report["keyframes_unacknowledged"] = tracker_.unacknowledged().size();
  report["keyframes_given_up"] = tracker_.num_given_up();
  AddMapsTo(&report, trajectories);
  const RadialResidual& residual = tracker_.camera().residual;
  report["lens_residual"] = {residual.k1, residual.k2};
  const auto& frame_times = times.samples().find("frame");
  report["frame_ms"] =
      SummarizeTimes(frame_times == times.samples().end() ? std::vector<double>() : frame_times->second);
  if (setup_.options.out.empty()) return kExitOk;
  Status written = WriteRunOutput(setup_.options.out, trajectories, tracker_.replicas());
  if (written) written = WriteReport(setup_.options, report);
  if (written && !IsWaitingForEarlierMaps()) so_far_.Close();
  if (written) return kExitOk;
  spdlog::error("{}", written.error().message);
  return kExitFailure;
}

}  // namespace portolan
