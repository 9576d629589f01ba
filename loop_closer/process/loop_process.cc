#include "process/loop_process.h"

#include <utility>

#include "base/hash.h"
#include "process/held_bytes.h"
#include "process/loop_report.h"
#include "process/process_report.h"

namespace portolan {
namespace {

constexpr double kStatusPeriodS = 1.0;
constexpr double kTickPeriodS = 0.15;  // well within the liveliness lease of 500 ms
constexpr double kLogPeriodS = 5.0;
constexpr int kBackgroundNiceSteps = 6;                     // behind the atlas_server too: nobody waits for a global BA
constexpr auto kAnswerPatience = std::chrono::seconds(10);  // many times what an owner takes to apply a correction

}  // namespace

LoopProcess::LoopProcess(const ProcessSetup& setup, const LoopOptions& options,
                         std::shared_ptr<const Vocabulary> vocabulary, Bus* bus, const std::string& priority,
                         ProcessLoop* loop)
    : setup_(setup),
      bus_(bus),
      priority_(priority),
      loop_(loop),
      status_(bus, setup, priority),
      snapshot_writer_(bus->CreateWriter<SnapshotRequest>()),
      correction_writer_(bus->CreateWriter<MapCorrection>()),
      state_writer_(bus->CreateWriter<FollowerState>()),
      request_writer_(bus->CreateWriter<Request>()),
      closer_(options, std::move(vocabulary), setup.process),
      request_ids_(setup.options.robot, setup.session),
      is_standby_(setup.options.standby),
      background_(loop, kBackgroundNiceSteps) {
  state_.process = setup.process;
  closer_.SetActive(!is_standby_);
}

LoopProcess::~LoopProcess() {
  readers_.clear();
}

void LoopProcess::ConnectReaders() {
  const auto post = [this](auto handle) {
    return [this, handle](auto message) {
      const size_t held_bytes = HeldBytes(message);
      loop_->Post([this, handle, message = std::move(message)] { (this->*handle)(message); }, held_bytes);
    };
  };
  readers_.push_back(bus_->CreateReader<KeyFrameMessage>(post(&LoopProcess::OnKeyFrame)));
  readers_.push_back(bus_->CreateReader<MapDeltaChunk>(post(&LoopProcess::OnDeltaChunk)));
  readers_.push_back(bus_->CreateReader<MapperState>(post(&LoopProcess::OnMapperState)));
  readers_.push_back(bus_->CreateReader<ProcessStatus>(post(&LoopProcess::OnStatus)));
  readers_.push_back(bus_->CreateReader<TrackerState>(post(&LoopProcess::OnTrackerState)));
  readers_.push_back(bus_->CreateReader<Command>(post(&LoopProcess::OnCommand)));
}

int LoopProcess::Run() {
  ConnectReaders();
  loop_->AddTimer(kStatusPeriodS, [this] { OnStatusTimer(); });
  loop_->AddTimer(kTickPeriodS, [this] { OnTick(); });
  loop_->AddTimer(kLogPeriodS, [this] { OnLogTimer(); });
  OnStatusTimer();
  loop_->Run();
  background_.Cancel();  // its end is not heard any more: it only competes with what is left to do
  readers_.clear();
  return Finish();
}

void LoopProcess::OnKeyFrame(const KeyFrameMessage& message) {
  if (message.kind == KeyFrameKind::kQuery) return;  // the atlas_server's
  const Stopwatch stopwatch;
  if (!closer_.follower().AddKeyFrame(message) && foreign_++ == 0)
    spdlog::error("keyframes of no map, or made with another vocabulary, are passed over");
  times_.Add("keyframe_words", stopwatch.Milliseconds());
  Continue();
}

void LoopProcess::OnDeltaChunk(const MapDeltaChunk& chunk) {
  closer_.follower().AddChunk(chunk);
  Continue();
}

void LoopProcess::OnMapperState(const MapperState& state) {
  closer_.OnMapperState(state);
  Continue();
}

void LoopProcess::OnStatus(const ProcessStatus& status) {
  if (status.process != setup_.process) closer_.follower().OnStatus(status);
}

void LoopProcess::OnTrackerState(const TrackerState& state) {
  closer_.follower().OnTrackerState(state);
}

void LoopProcess::OnCommand(const Command& command) {
  closer_.OnCommand(command);
  const bool is_mine = command.robot == setup_.options.robot;
  if (command.kind == CommandKind::kDrain && is_mine && command.owner != command.sender) OnDrain(command.owner);
  // It was the mapper that did.
  if (command.kind == CommandKind::kAppointMapper && is_mine && is_standby_) draining_ = ProcessId();
  if (command.kind == CommandKind::kAppointLoopCloser && is_mine) OnAppointment(command.owner);
  Continue();
}

void LoopProcess::Continue() {
  // A keyframe at a time: what waits behind it, timers among them, gets its turn.
  if (closer_.Update()) loop_->Post([this] { Continue(); });
  if (closer_.ShouldCancel()) background_.Cancel();
  if (!background_.busy()) {
    if (auto job = closer_.NextJob()) StartJob(std::move(*job));
  }
  PublishState();
}

void LoopProcess::StartJob(LoopCloser::Job job) {
  background_.Start(
      [this, job = std::move(job)](const std::atomic<bool>& stop) {
        // Events are copied: the result, with thousands of points, is not.
        auto result = std::make_shared<LoopCloser::JobResult>(job(stop));
        return [this, result] {
          closer_.OnJobDone(std::move(*result));
          if (const auto correction = closer_.TakeCorrection()) {
            correction_writer_->Write(*correction);
            proposed_at_ = Clock::now();
          }
          Continue();
        };
      },
      [this] {
        closer_.OnJobCancelled();
        Continue();
      });
}

void LoopProcess::PublishState() {
  const MapId map = closer_.last_map();
  const bool is_new =
      map != state_.map || closer_.last_keyframe() != state_.last_keyframe || closer_.is_busy() != state_.is_busy;
  if (!is_new) return;
  const Map* replica = closer_.follower().Find(map);
  state_.map = map;
  state_.epoch = replica != nullptr ? replica->epoch() : 0;
  state_.revision = replica != nullptr ? replica->revision() : 0;
  state_.last_keyframe = closer_.last_keyframe();
  state_.is_busy = closer_.is_busy();
  state_writer_->Write(state_);
}

void LoopProcess::OnTick() {
  status_.AssertLiveliness();
  const double now_s = std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
  for (const SnapshotRequest& request : closer_.follower().DueRequests(now_s, setup_.process)) {
    snapshot_writer_->Write(request);
    ++snapshots_asked_;
  }
  ContinueDrain(false);
  if (closer_.AwaitsAnswer() && Clock::now() - proposed_at_ > kAnswerPatience)
    closer_.ForgetCorrection("no answer from the map's owner");
  Continue();
}

void LoopProcess::OnLogTimer() {
  const MapId active = closer_.follower().active_map();
  if (!active.IsValid()) return;
  const MapFollower::Summary summary = closer_.follower().Summarize(active);
  if (summary.map == logged_map_ && summary.revision == logged_revision_) return;
  logged_map_ = summary.map;
  logged_revision_ = summary.revision;
  spdlog::info("map {} at revision {} ({} behind): {} keyframes, {} points, {} covisibility edges",
               ToString(summary.map), summary.revision, summary.lag, summary.keyframes, summary.points,
               summary.covisibility_edges);
}

void LoopProcess::OnStatusTimer() {
  ContinueDrain(true);
  state_writer_->Write(state_);  // again and again: a sign of life for who waits for it, and for who came late
  const MapId active = closer_.follower().active_map();
  const MapFollower::Summary summary = active.IsValid() ? closer_.follower().Summarize(active) : MapFollower::Summary();
  std::vector<std::pair<std::string, double>> figures = LoopFigures(closer_.journal());
  figures.insert(figures.end(), {{"keyframes", static_cast<double>(summary.keyframes)},
                                 {"points", static_cast<double>(summary.points)},
                                 {"covisibility_edges", static_cast<double>(summary.covisibility_edges)},
                                 {"indexed_keyframes", static_cast<double>(closer_.follower().index().size())},
                                 {"lag", static_cast<double>(summary.lag)},
                                 {"snapshots_asked", static_cast<double>(snapshots_asked_)},
                                 {"foreign_keyframes", static_cast<double>(foreign_)},
                                 {"events_waiting", static_cast<double>(loop_->depth())},
                                 {"events_dropped", static_cast<double>(loop_->dropped())}});
  status_.Publish(StateInWords(active.IsValid()), active, summary.epoch, summary.revision, std::move(figures));
}

int LoopProcess::Finish() {
  closer_.Update();
  closer_.End();
  StageTimes times = times_;
  for (const auto& [stage, samples] : closer_.stage_times().samples()) {
    for (const double sample : samples) times.Add(stage, sample);
  }
  nlohmann::json report = MakeReport(setup_.options, priority_, times, *bus_);
  AddLoops(closer_.journal(), &report);
  size_t keyframes = 0, points = 0, edges = 0;
  for (const MapId id : closer_.follower().Maps()) {
    const MapFollower::Summary summary = closer_.follower().Summarize(id);
    keyframes += summary.keyframes;
    points += summary.points;
    edges += summary.covisibility_edges;
  }
  report["maps"] = closer_.follower().Maps().size();
  report["keyframes"] = keyframes;
  report["points"] = points;
  report["covisibility_edges"] = edges;
  report["indexed_keyframes"] = closer_.follower().index().size();
  report["snapshots_asked"] = snapshots_asked_;
  const MapReplica::Counters counters = closer_.follower().counters();
  report["deltas"] = {{"applied", counters.applied},
                      {"repeated", counters.repeated},
                      {"stale_epoch", counters.stale_epoch},
                      {"gaps", counters.gaps}};
  report["map_hash"] = nlohmann::json::object();
  for (const auto& [id, hash] : closer_.follower().Hashes()) report["map_hash"][ToString(id)] = FormatHash(hash);
  if (Status written = WriteReport(setup_.options, report); !written) {
    spdlog::error("{}", written.error().message);
    return kExitFailure;
  }
  return kExitOk;
}

}  // namespace portolan
