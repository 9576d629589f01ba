// Runs tracker, mapper and loop closer in one process on a data set, in lockstep: for work on the algorithm. Writes the
// trajectories of portolan's run.sh.

#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <opencv2/core/utility.hpp>

#include "base/command_line.h"
#include "base/log.h"
#include "dataset/calibration.h"
#include "dataset/image_source.h"
#include "dataset/trajectory_io.h"
#include "map/map_file.h"
#include "mapping/mapper_config.h"
#include "pipeline/pipeline.h"
#include "tracking/joined_trajectory.h"
#include "tracking/tracker_config.h"
#include "version/version.h"

namespace portolan {
namespace {

int Run(const SourceOptions& source_options, const std::string& out, const TrackerOptions& tracker_options,
        const MapperOptions& mapper_options, const LoopOptions& loop_options, int every, uint32_t session,
        const std::string& maps_file) {
  std::error_code problem;
  std::filesystem::create_directories(out, problem);
  if (problem) {
    spdlog::error("--out {}: can't be made: {}", out, problem.message());
    return 2;
  }
  auto vocabulary = Vocabulary::Open(Vocabulary::DefaultPath());
  if (!vocabulary) {
    spdlog::error("{}", vocabulary.error().message);
    return 2;
  }
  auto source = OpenImageSource(source_options);
  if (!source) {
    spdlog::error("{}", source.error().message);
    return 2;
  }
  Pipeline pipeline(tracker_options, mapper_options, loop_options, (*source)->camera(), *vocabulary, session);
  uint64_t frames = 0, tracked = 0;
  for (;;) {
    auto image = (*source)->Next();
    if (!image) {
      spdlog::warn("{}", image.error().message);
      continue;
    }
    if (!*image) break;
    if (every > 1 && (*image)->frame % static_cast<uint64_t>(every) != 0) continue;
    ++frames;
    const Tracker::Output output = pipeline.Track(**image);
    tracked += output.state.state == TrackingState::kTracking;
    spdlog::debug("frame {} state {} n {} m {} s {:.2f} map {} kf {} {:.1f} ms", output.state.frame,
                  static_cast<int>(output.state.state), output.state.num_inliers, output.state.num_candidates,
                  output.state.quality, ToString(output.state.map), output.keyframes.size(), output.state.frame_ms);
  }
  pipeline.tracker().FinishHistory();
  const Tracker& tracker = pipeline.tracker();
  const RunTrajectories trajectories = MakeTrajectories(tracker.history(), tracker.replicas(), tracker.links());
  const Trajectory& trajectory = trajectories.joined;
  for (const auto& [name, is_last] : {std::pair{"/trajectory.txt", false}, std::pair{"/trajectory_maps.txt", true}}) {
    if (Status status = WriteTrajectory(out + name, is_last ? trajectories.per_map : trajectory, is_last); !status) {
      spdlog::error("{}", status.error().message);
      return 1;
    }
  }
  if (!maps_file.empty()) {
    std::vector<const Map*> maps;
    for (const auto& [id, mapper] : pipeline.mappers()) maps.push_back(&mapper->map());
    if (Status status = WriteMapFile(maps_file, maps); !status) {
      spdlog::error("{}", status.error().message);
      return 1;
    }
  }
  std::printf("frames %zu online %zu trajectory %zu keyframes sent %zu\n", static_cast<size_t>(frames),
              static_cast<size_t>(tracked), trajectory.size(),
              static_cast<size_t>(pipeline.tracker().num_keyframes_sent()));
  const MapEvents& events = tracker.map_events();
  std::printf("maps %zu links %zu unlinked %zu switches %zu fusions %zu; frames to a new map:",
              trajectories.map_numbers.size(), tracker.links().num_links(), trajectories.unlinked_maps.size(),
              static_cast<size_t>(events.switches), static_cast<size_t>(events.fusions));
  for (const int frames_to_map : events.frames_to_new_map) std::printf(" %d", frames_to_map);
  std::printf("\n");
  for (const auto& [id, mapper] : pipeline.mappers()) {
    std::printf("map %s: %zu keyframes, %zu points\n", ToString(id).c_str(), mapper->map().keyframes().size(),
                mapper->map().points().size());
    for (const auto& [stage, samples] : mapper->stage_times().samples()) {
      std::printf("  %-12s %6zu x median %6.1f p95 %6.1f ms\n", stage.c_str(), samples.size(), Quantile(samples, 0.5),
                  Quantile(samples, 0.95));
    }
  }
  for (const auto& [stage, samples] : pipeline.tracker().stage_times().samples()) {
    std::printf("  %-12s %6zu x median %6.1f p95 %6.1f ms\n", stage.c_str(), samples.size(), Quantile(samples, 0.5),
                Quantile(samples, 0.95));
  }
  return 0;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  CLI::App app("Tracker, mapper and loop closer in one process on a data set, in lockstep");
  app.set_version_flag("--version", "portolan_pipeline_run " + portolan::BuildDescription());
  portolan::SourceOptions source;
  portolan::TrackerOptions tracker;
  portolan::MapperOptions mapper;
  portolan::LoopOptions loop;
  std::string out = ".", level = "info", maps;
  int every = 1;
  uint32_t session = 1;
  std::vector<std::string> sets;
  app.add_option("--data", source.data, "data set folder")->required();
  app.add_option("--camera", source.camera_file);
  app.add_option("--out", out, "folder for the trajectories, made if it is not there");
  app.add_option("--session", session, "of the ids, for maps of several runs")->check(CLI::Range(1, 0xffffff));
  app.add_option("--save-maps", maps, "write the finished maps into this file");
  app.add_option("--log", level);
  app.add_option("--every", every, "take every n-th frame");
  app.add_option("--first", source.first_frame);
  app.add_option("--frames", source.max_frames);
  app.add_option("--set", sets, "one value of the configuration: section.key=value (repeatable)");
  if (const auto code = portolan::ParseCommandLine(&app, argc, argv)) return *code;
  cv::setNumThreads(1);
  portolan::LogOptions log;
  log.process = "pipeline";
  log.level = level;
  if (auto status = portolan::SetUpLog(log); !status) {
    std::fprintf(stderr, "%s\n", status.error().message.c_str());
    return 2;
  }
  portolan::ConfigReader config;
  portolan::Status read = portolan::Ok{};
  for (const std::string& set : sets) read = read ? config.Set(set) : read;
  if (read) read = portolan::ReadTrackerOptions(&config, &tracker);
  if (read) read = portolan::ReadMapperOptions(&config, &mapper);
  if (read) read = portolan::ReadLoopOptions(&config, &loop);
  if (read) read = config.Finish();
  if (!read) {
    spdlog::error("{}", read.error().message);
    return 2;
  }
  return portolan::Run(source, out, tracker, mapper, loop, every, session, maps);
}
