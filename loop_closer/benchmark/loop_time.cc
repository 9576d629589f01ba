// portolan_loop_time: what loops cost the loop_closer in a map of many keyframes, made by the synthetic builder: a
// street that was driven round once and a little more, with the drift of a lap. Times of lookups, verifications and
// jobs, and how soon a job ends that is told to stop.

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <future>
#include <optional>
#include <utility>

#include "base/command_line.h"
#include "base/statistics.h"
#include "base/time.h"
#include "loop/loop_closer.h"
#include "map_optimization/map_correction.h"
#include "testing/drifted_map.h"

namespace portolan {
namespace {

using JobKind = LoopCloser::JobKind;
using JobResult = LoopCloser::JobResult;

constexpr double kStep = 0.4;           // from keyframe to keyframe, world units
constexpr int kRevisited = 30;          // keyframes at the end of the way, beyond the lap
constexpr int kSeenAhead = 20;          // keyframes before them that see the places of the first ones from afar
constexpr double kScaleDrift = 0.8;     // of the lap; town_lap's is as large
constexpr double kLandmarksAStep = 50;  // some 350 in view
constexpr size_t kMaxChunkElements = 20000;
const ProcessId kMapper(0, 1, 1), kLoopCloser(0, 1, 7);
const std::atomic<bool> kGoOn{false};

struct Arguments {
  int keyframes = 1000, lookups = 200, runs = 3;
};

SyntheticScene MakeLap(int keyframes) {
  SyntheticSceneOptions options;
  options.landmarks = LandmarkLayout::kStreet;
  options.motion = CameraMotion::kStreetLap;
  options.num_views = keyframes;
  options.lap = kStep * (keyframes - kRevisited);
  options.travel = kStep * (keyframes - 1);
  options.num_landmarks = static_cast<int>(kLandmarksAStep * (keyframes - kRevisited));
  options.sight = 6;
  options.pixel_sigma_px = 0.5;
  options.descriptor_flip_ratio = 0.03;
  options.num_clutter = 1400;  // some 2000 features an image, as real ones have
  return MakeSyntheticScene(options);
}

Map MakeDriftedLap(const SyntheticScene& scene) {
  const auto steps = static_cast<double>(scene.views.size());
  DriftOptions drift;
  drift.scale_step = std::pow(kScaleDrift, 1 / steps);
  drift.turn_step = Eigen::Vector3d(0.05, 0.1, 0.02) / steps;
  drift.point_sigma = 0.005;
  return std::move(BuildDriftedMap(scene, drift).map);
}

/// A line of the table.
struct Row {
  const char* stage;
  const char* name;
  double to_meet_ms;  ///< the issue's figure; 0: there is none
};

/// Those of which something was measured.
void Print(const std::vector<Row>& rows, const StageTimes& times) {
  for (const Row& row : rows) {
    const auto found = times.samples().find(row.stage);
    if (found == times.samples().end()) continue;
    const std::vector<double>& samples = found->second;
    fmt::print("{:34} {:6} {:9.2f} {:9.2f} {:9.2f}  {}\n", row.name, samples.size(), Quantile(samples, 0.5),
               Quantile(samples, 0.95), Quantile(samples, 1),
               row.to_meet_ms > 0 ? fmt::format("{:.0f}", row.to_meet_ms) : "");
  }
}

/// A job keeps the times of its run: each run is one of a copy.
JobResult RunCopy(LoopCloser::Job job, const std::atomic<bool>& stop) {
  return job(stop);
}

/// Milliseconds from the moment at which a job is told to stop until it has ended. Begun anew for each of several
/// moments of its duration.
std::vector<double> TimeStops(const LoopCloser::Job& job, double duration_ms) {
  std::vector<double> times;
  for (const double share : {0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95}) {
    std::atomic<bool> stop{false};
    const std::future<void> ended = std::async(std::launch::async, [&job, &stop] { RunCopy(job, stop); });
    const auto moment = std::chrono::duration<double, std::milli>(share * duration_ms);
    if (ended.wait_for(moment) == std::future_status::ready) continue;  // faster than before
    const Stopwatch since_stop;
    stop = true;
    ended.wait();
    times.push_back(since_stop.Milliseconds());
  }
  return times;
}

/// A map's owner and the loop_closer that follows it.
class Benchmark {
 public:
  Benchmark(const Arguments& arguments, std::shared_ptr<const Vocabulary> vocabulary)
      : arguments_(arguments),
        vocabulary_hash_(vocabulary->hash()),
        scene_(MakeLap(arguments.keyframes)),
        owner_(MakeDriftedLap(scene_)),
        closer_(LoopOptions(), std::move(vocabulary), kLoopCloser) {}

  Status Run() {
    Follow();
    const size_t revisit = scene_.views.size() - kRevisited - kSeenAhead;
    size_t next = revisit - std::min(revisit, static_cast<size_t>(arguments_.lookups));
    while (next < revisit) LookAt(next++);
    if (const auto forward = closer_.NextJob()) {  // due after so many keyframes
      TimeJob("FBA", *forward);
      closer_.OnJobCancelled();
    }
    while (next < scene_.views.size() && closer_.closures().empty()) LookAt(next++);
    if (closer_.closures().empty()) return Error{"the loop was not found"};
    if (Status closed = CloseLoop(); !closed) return closed;
    if (const auto global = closer_.NextJob()) TimeJob("global BA", *global);
    PrintTable();
    return Ok{};
  }

 private:
  void Follow() {
    closer_.follower().Follow(owner_.id());
    SendDelta();  // first: a follower keeps but a few keyframes that no delta has named
    for (const SyntheticView& view : scene_.views) {
      KeyFrameMessage message;
      message.kind = KeyFrameKind::kCopy;
      message.map = owner_.id();
      message.data = *view.data;
      message.vocabulary_hash = vocabulary_hash_;
      closer_.follower().AddKeyFrame(message);
    }
    closer_.Update();
  }

  void SendDelta() {
    for (MapDeltaChunk& chunk : SplitDelta(owner_.TakeDelta(), kMaxChunkElements))
      closer_.follower().AddChunk(std::move(chunk));
  }

  void LookAt(size_t view) {
    state_.process = kMapper;
    state_.map = owner_.id();
    state_.epoch = owner_.epoch();
    state_.revision = owner_.revision();
    state_.last_keyframe = scene_.views[view].data->id;
    closer_.OnMapperState(state_);
    while (closer_.Update()) {
    }
  }

  /// Runs a job to its end, then again and again with a stop on the way. @return what came of it.
  JobResult TimeJob(const std::string& name, const LoopCloser::Job& job) {
    const Stopwatch stopwatch;
    JobResult result = RunCopy(job, kGoOn);
    const double duration_ms = stopwatch.Milliseconds();
    times_.Add(name, duration_ms);
    for (const double stopped_ms : TimeStops(job, duration_ms)) times_.Add(name + " stopped", stopped_ms);
    return result;
  }

  /// From the loop that was found to the map that has it, in its owner.
  Status CloseLoop() {
    const Stopwatch stopwatch;
    const auto job = closer_.NextJob();
    const double snapshot_ms = stopwatch.Milliseconds();
    if (!job) return Error{"no correction is due"};
    for (int run = 0; run < arguments_.runs; ++run) {
      Map owner = owner_;
      const Stopwatch correction;
      JobResult result = RunCopy(*job, kGoOn);
      if (!result.correction) return result.correction.error();
      const Stopwatch application;
      if (const auto applied = ApplyMapCorrection(*result.correction, &owner); !applied) return applied.error();
      owner.TakeDelta();
      times_.Add("loop_applied", application.Milliseconds());
      times_.Add("correction", snapshot_ms + correction.Milliseconds());
      for (const auto& [step, samples] : result.times.samples()) times_.Add(step, samples.front());
    }
    times_.Add("loop_snapshot", snapshot_ms);
    closer_.OnJobDone(TimeJob("loop", *job));
    return Answer();
  }

  Status Answer() {
    const auto correction = closer_.TakeCorrection();
    if (!correction) return Error{"no correction came out"};
    if (const auto applied = ApplyMapCorrection(*correction, &owner_); !applied) return applied.error();
    SendDelta();
    state_.correction_process = correction->process;
    state_.correction_number = correction->number;
    state_.revision = owner_.revision();
    closer_.OnMapperState(state_);
    closer_.Update();
    return closer_.closures().front().is_applied ? Status(Ok{}) : Status(Error{closer_.closures().front().problem});
  }

  void PrintTable() const {
    const ClosureRecord& loop = closer_.closures().front();
    const LoopCounters& counters = closer_.counters();
    fmt::print(
        "{} keyframes, {} points; {} keyframes looked at, {} candidates, {} refused; {} closes the loop with {}\n",
        owner_.keyframes().size(), owner_.points().size(), counters.looked_at, counters.candidates, counters.refused,
        ToString(loop.current), ToString(loop.matched));
    fmt::print("{:34} {:>6} {:>9} {:>9} {:>9}  {}\n", "ms", "times", "median", "p95", "max", "at most");
    const double correction_to_meet = arguments_.keyframes <= 450 ? 500 : arguments_.keyframes <= 1000 ? 2000 : 0;
    const std::vector<Row> of_lookups = {
        {"words", "candidate lookup", 3},        {"verify", "verification of a candidate", 30},
        {"verify_words", "  words", 0},          {"verify_ransac", "  RANSAC", 0},
        {"verify_refine", "  refinement", 0},    {"verify_wide", "  wide search", 0},
        {"verify_neighbours", "  neighbours", 0}};
    const std::vector<Row> of_jobs = {{"correction", "loop, from found to applied", correction_to_meet},
                                      {"loop_snapshot", "  snapshot", 0},
                                      {"loop_window", "  window", 0},
                                      {"loop_fusion", "  fusion", 0},
                                      {"loop_welding", "  welding BA", 0},
                                      {"loop_graph", "  pose graph", 0},
                                      {"loop_applied", "  applied by the owner", 0},
                                      {"loop stopped", "  told to stop", 0},
                                      {"FBA", "FBA", 0},
                                      {"FBA stopped", "  told to stop", 0},
                                      {"global BA", "global BA", 0},
                                      {"global BA stopped", "  told to stop", 0}};
    Print(of_lookups, closer_.stage_times());
    Print(of_jobs, times_);
  }

  const Arguments& arguments_;
  uint64_t vocabulary_hash_;
  const SyntheticScene scene_;
  Map owner_;
  LoopCloser closer_;
  MapperState state_;
  StageTimes times_;
};

Status Run(const Arguments& arguments) {
  const auto vocabulary = Vocabulary::Open(Vocabulary::DefaultPath());
  if (!vocabulary) return vocabulary.error();
  spdlog::set_level(spdlog::level::warn);
  return Benchmark(arguments, *vocabulary).Run();
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  CLI::App app("Times of loop closing in a map of many keyframes", "portolan_loop_time");
  portolan::Arguments arguments;
  app.add_option("--keyframes", arguments.keyframes, "of the map")
      ->check(CLI::Range(100, 100000))
      ->capture_default_str();
  app.add_option("--lookups", arguments.lookups, "keyframes looked at before the place is seen again")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  app.add_option("--runs", arguments.runs, "of the correction")->check(CLI::Range(1, 1000))->capture_default_str();
  if (const auto code = portolan::ParseCommandLine(&app, argc, argv)) return *code;
  const portolan::Status status = portolan::Run(arguments);
  if (!status) fmt::print(stderr, "portolan_loop_time: {}\n", status.error().message);
  return status.ok() ? 0 : 1;
}
