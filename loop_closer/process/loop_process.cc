#include "process/loop_process.h"

#include <utility>

#include "base/hash.h"
#include "process/process_report.h"

namespace portolan {
namespace {

constexpr double kStatusPeriodS = 1.0;
constexpr double kTickPeriodS = 0.15;  // well within the liveliness lease of 500 ms
constexpr double kLogPeriodS = 5.0;

}  // namespace

LoopProcess::LoopProcess(const ProcessSetup& setup, std::shared_ptr<const Vocabulary> vocabulary, Bus* bus,
                         const std::string& priority, ProcessLoop* loop)
    : setup_(setup),
      bus_(bus),
      priority_(priority),
      loop_(loop),
      status_(bus, setup, priority),
      snapshot_writer_(bus->CreateWriter<SnapshotRequest>()),
      follower_(std::move(vocabulary)) {}

LoopProcess::~LoopProcess() {
  readers_.clear();
}

void LoopProcess::ConnectReaders() {
  const auto post = [this](auto handle) {
    return [this, handle](auto message) {
      loop_->Post([this, handle, message = std::move(message)] { (this->*handle)(message); });
    };
  };
  readers_.push_back(bus_->CreateReader<KeyFrameMessage>(post(&LoopProcess::OnKeyFrame)));
  readers_.push_back(bus_->CreateReader<MapDeltaChunk>(post(&LoopProcess::OnDeltaChunk)));
  readers_.push_back(bus_->CreateReader<MapperState>(post(&LoopProcess::OnMapperState)));
  readers_.push_back(bus_->CreateReader<ProcessStatus>(post(&LoopProcess::OnStatus)));
}

int LoopProcess::Run() {
  ConnectReaders();
  loop_->AddTimer(kStatusPeriodS, [this] { OnStatusTimer(); });
  loop_->AddTimer(kTickPeriodS, [this] { OnTick(); });
  loop_->AddTimer(kLogPeriodS, [this] { OnLogTimer(); });
  OnStatusTimer();
  loop_->Run();
  readers_.clear();
  return Finish();
}

void LoopProcess::OnKeyFrame(const KeyFrameMessage& message) {
  const Stopwatch stopwatch;
  if (!follower_.AddKeyFrame(message) && foreign_++ == 0)
    spdlog::error("keyframes of no map, or made with another vocabulary, are passed over");
  times_.Add("words", stopwatch.Milliseconds());
  ApplyPending();
}

void LoopProcess::OnDeltaChunk(const MapDeltaChunk& chunk) {
  follower_.AddChunk(chunk);
  ApplyPending();
}

void LoopProcess::OnStatus(const ProcessStatus& status) {
  if (status.process != setup_.process) follower_.OnStatus(status);
}

void LoopProcess::ApplyPending() {
  const Stopwatch stopwatch;
  if (!follower_.ApplyPending().empty()) times_.Add("apply", stopwatch.Milliseconds());
}

void LoopProcess::OnTick() {
  status_.AssertLiveliness();
  const double now_s = std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
  for (const SnapshotRequest& request : follower_.DueRequests(now_s, setup_.process)) {
    snapshot_writer_->Write(request);
    ++snapshots_asked_;
  }
}

void LoopProcess::OnLogTimer() {
  const MapId active = follower_.active_map();
  if (!active.IsValid()) return;
  const MapFollower::Summary summary = follower_.Summarize(active);
  if (summary.map == logged_map_ && summary.revision == logged_revision_) return;
  logged_map_ = summary.map;
  logged_revision_ = summary.revision;
  spdlog::info("map {} at revision {} ({} behind): {} keyframes, {} points, {} covisibility edges",
               ToString(summary.map), summary.revision, summary.lag, summary.keyframes, summary.points,
               summary.covisibility_edges);
}

void LoopProcess::OnStatusTimer() {
  const MapId active = follower_.active_map();
  const MapFollower::Summary summary = active.IsValid() ? follower_.Summarize(active) : MapFollower::Summary();
  status_.Publish(active.IsValid() ? "following" : "waiting for a map", active, summary.epoch, summary.revision,
                  {{"keyframes", static_cast<double>(summary.keyframes)},
                   {"points", static_cast<double>(summary.points)},
                   {"covisibility_edges", static_cast<double>(summary.covisibility_edges)},
                   {"indexed_keyframes", static_cast<double>(follower_.index().size())},
                   {"lag", static_cast<double>(summary.lag)},
                   {"snapshots_asked", static_cast<double>(snapshots_asked_)},
                   {"foreign_keyframes", static_cast<double>(foreign_)},
                   {"events_waiting", static_cast<double>(loop_->depth())},
                   {"events_dropped", static_cast<double>(loop_->dropped())}});
}

int LoopProcess::Finish() {
  ApplyPending();
  nlohmann::json report = MakeReport(setup_.options, priority_, times_, *bus_);
  size_t keyframes = 0, points = 0, edges = 0;
  for (const MapId id : follower_.Maps()) {
    const MapFollower::Summary summary = follower_.Summarize(id);
    keyframes += summary.keyframes;
    points += summary.points;
    edges += summary.covisibility_edges;
  }
  report["maps"] = follower_.Maps().size();
  report["keyframes"] = keyframes;
  report["points"] = points;
  report["covisibility_edges"] = edges;
  report["indexed_keyframes"] = follower_.index().size();
  report["snapshots_asked"] = snapshots_asked_;
  const MapReplica::Counters counters = follower_.counters();
  report["deltas"] = {{"applied", counters.applied},
                      {"repeated", counters.repeated},
                      {"stale_epoch", counters.stale_epoch},
                      {"gaps", counters.gaps}};
  report["map_hash"] = nlohmann::json::object();
  for (const auto& [id, hash] : follower_.Hashes()) report["map_hash"][ToString(id)] = FormatHash(hash);
  if (Status written = WriteReport(setup_.options, report); !written) {
    spdlog::error("{}", written.error().message);
    return kExitFailure;
  }
  return kExitOk;
}

}  // namespace portolan
