#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include "base/atomic_file.h"
#include "base/command_line.h"
#include "base/flat_yaml.h"
#include "dataset/evaluation_report.h"
#include "dataset/frame_times.h"
#include "dataset/loop_closures.h"
#include "dataset/text_table.h"
#include "dataset/trajectory_evaluation.h"
#include "dataset/trajectory_io.h"
#include "dataset/trajectory_plot.h"
#include "version/version.h"

namespace portolan {
namespace {

constexpr int kExitFailure = 1;  // no comparison possible, or not written

/// What the command line says, before the files are read.
struct Arguments {
  std::string groundtruth, trajectory;
  std::string times_file;  ///< of KITTI poses
  std::string frames;      ///< a number, or a list of the camera's frames; empty: the list beside the ground truth
  std::string plot, closures, json, scale = "free", rpe_delta = "1s";
  bool per_map = false;
  double max_dt = 0;
  std::string from, to;  ///< seconds
  int64_t first_frame = -1, last_frame = -1;
};

/// The camera's frames, as far as their times are known; empty: every ground truth pose counts as one.
Result<std::vector<Timestamp>> FindFrames(const Arguments& arguments, const EvaluationOptions& options) {
  if (options.num_frames > 0) return std::vector<Timestamp>();
  const std::string list = arguments.frames.empty() ? FindFrameTimes(arguments.groundtruth) : arguments.frames;
  if (list.empty()) return std::vector<Timestamp>();
  return ReadFrameTimes(list);
}

/// The times of poses in KITTI's form; empty if there are none.
std::string FindPoseTimes(const Arguments& arguments) {
  if (!arguments.times_file.empty()) return arguments.times_file;
  const std::filesystem::path beside = std::filesystem::path(arguments.groundtruth).parent_path() / "times.txt";
  return std::filesystem::exists(beside) ? beside.string() : "";
}

/// A limit of the span; none for no frame. @param option that gave it.
Result<std::optional<Timestamp>> TimeOfFrame(const std::string& option, int64_t frame,
                                             const std::vector<Timestamp>& times) {
  if (frame < 0) return std::optional<Timestamp>();
  if (static_cast<size_t>(frame) < times.size()) return std::optional<Timestamp>(times[static_cast<size_t>(frame)]);
  return Error{fmt::format("{} {}: there are {} frames", option, frame, times.size())};
}

/// Empty text: no limit.
Status ParseLimit(const std::string& option, const std::string& text, std::optional<Timestamp>* limit) {
  if (text.empty()) return Ok{};
  *limit = ParseSeconds(text);
  if (*limit) return Ok{};
  return Error{fmt::format("{} {}: expected seconds", option, text)};
}

/// "1.5s" or "10" or "10frames".
Status ParseRpeDelta(const std::string& text, EvaluationOptions* options) {
  const size_t unit_start = text.find_first_not_of("0123456789.+-e");
  const std::string number = text.substr(0, unit_start);
  const std::string unit = unit_start == std::string::npos ? "" : text.substr(unit_start);
  int64_t frames = 0;
  if (unit == "s" && ParseNumber(number, &options->rpe_delta) && options->rpe_delta > 0) return Ok{};
  if ((unit.empty() || unit == "frames") && ParseNumber(number, &frames) && frames > 0 && frames < 1000000) {
    options->rpe_frames = static_cast<int>(frames);
    return Ok{};
  }
  return Error{"--rpe-delta " + text + ": expected seconds as in 1.5s, or a number of frames"};
}

/// What the command line says without the files. A failure is a bad argument.
Result<EvaluationOptions> ParseOptions(const Arguments& arguments) {
  EvaluationOptions options;
  options.fix_scale = arguments.scale == "fixed";
  options.max_dt = arguments.max_dt;
  if (Status parsed = ParseRpeDelta(arguments.rpe_delta, &options); !parsed) return parsed.error();
  if (Status parsed = ParseLimit("--from", arguments.from, &options.from); !parsed) return parsed.error();
  if (Status parsed = ParseLimit("--to", arguments.to, &options.to); !parsed) return parsed.error();
  int64_t num_frames = 0;
  if (ParseNumber(arguments.frames, &num_frames)) {
    if (num_frames < 1) return Error{"--frames " + arguments.frames + ": expected 1 or more"};
    options.num_frames = static_cast<size_t>(num_frames);
  }
  const std::string kind = std::filesystem::path(arguments.plot).extension().string();
  if (arguments.plot.empty() || kind == ".svg" || kind == ".png") return options;
  return Error{"--plot " + arguments.plot + ": expected a name that ends in .svg or .png"};
}

Result<Evaluation> Evaluate(const Arguments& arguments, EvaluationOptions options) {
  const std::string pose_times = FindPoseTimes(arguments);
  Result<Trajectory> truth = ReadTrajectory(arguments.groundtruth, pose_times);
  if (!truth) return truth.error();
  const Result<Trajectory> estimate = ReadTrajectory(arguments.trajectory, pose_times);
  if (!estimate) return estimate.error();
  const Result<std::vector<Timestamp>> frames = FindFrames(arguments, options);
  if (!frames) return frames.error();
  if (options.max_dt <= 0) options.max_dt = HalfMedianInterval(*truth);
  std::vector<Timestamp> times = *frames;
  if (!times.empty()) {
    truth = SelectFrames(*truth, times, options.max_dt);
  } else {
    for (const TrajectoryPose& pose : *truth) times.push_back(pose.stamp);
  }
  const Result<std::optional<Timestamp>> first = TimeOfFrame("--first-frame", arguments.first_frame, times);
  if (!first) return first.error();
  const Result<std::optional<Timestamp>> last = TimeOfFrame("--last-frame", arguments.last_frame, times);
  if (!last) return last.error();
  if (*first) options.from = *first;
  if (*last) options.to = *last;
  options.frames = *frames;
  return EvaluateTrajectory(*truth, *estimate, options);
}

Status WriteOutputs(const Arguments& arguments, const Evaluation& evaluation) {
  const bool has_unit = arguments.rpe_delta.find_last_not_of("0123456789") != std::string::npos;
  std::cout << FormatEvaluation(evaluation, arguments.rpe_delta + (has_unit ? "" : " frames"));
  if (!arguments.json.empty()) {
    if (Status written = WriteFileAtomically(arguments.json, EvaluationToJson(evaluation)); !written) return written;
  }
  if (arguments.plot.empty()) return Ok{};
  TrajectoryPlotOptions plot;
  plot.title = std::filesystem::path(arguments.trajectory).filename().string();
  plot.per_map = arguments.per_map;
  if (!arguments.closures.empty()) {
    Result<std::vector<LoopClosure>> closures = ReadLoopClosures(arguments.closures);
    if (!closures) return closures.error();
    plot.closures = std::move(*closures);
  }
  return DrawTrajectories(evaluation, plot).Write(arguments.plot);
}

void Declare(CLI::App* app, Arguments* arguments) {
  app->add_option("groundtruth", arguments->groundtruth, "TUM, KITTI or EuRoC ground truth")->required();
  app->add_option("trajectory", arguments->trajectory, "estimate: TUM lines, a ninth column is the map's number")
      ->required();
  app->add_option("--times", arguments->times_file, "times of KITTI poses (default: times.txt beside them)");
  app->add_option("--frames", arguments->frames,
                  "number of frames for the coverage, or a list of them (default: rgb.txt, times.txt or "
                  "../cam0/data.csv beside the ground truth, else its poses)");
  app->add_option("--max-dt", arguments->max_dt,
                  "seconds between matched poses (default: half the ground truth's median interval)")
      ->check(CLI::PositiveNumber);
  app->add_option("--rpe-delta", arguments->rpe_delta,
                  "interval of the relative pose error: seconds as in 1s, or frames as in 10")
      ->capture_default_str();
  app->add_option("--scale", arguments->scale, "free: similarity; fixed: rigid alignment")
      ->check(CLI::IsMember({"free", "fixed"}))
      ->capture_default_str();
  auto* from = app->add_option("--from", arguments->from, "leave out poses before this time, seconds");
  auto* to = app->add_option("--to", arguments->to, "and after this one");
  app->add_option("--first-frame", arguments->first_frame, "leave out frames before this number")
      ->check(CLI::NonNegativeNumber)
      ->excludes(from);
  app->add_option("--last-frame", arguments->last_frame, "and after this one")
      ->check(CLI::NonNegativeNumber)
      ->excludes(to);
  auto* plot = app->add_option("--plot", arguments->plot, "draw both trajectories into this .svg or .png");
  app->add_flag("--per-map", arguments->per_map, "in the plot, align each map by itself");
  app->add_option("--closures", arguments->closures,
                  "in the plot, mark the loop closures of this file: loop_closer.json or summary.json of a run")
      ->needs(plot);
  app->add_option("--json", arguments->json, "write the figures into this file");
}

int Complain(const Error& error, int exit_code) {
  std::cerr << "portolan_eval: " << error.message << "\n";
  return exit_code;
}

int Main(int argc, char** argv) {
  CLI::App app(
      "Compares a trajectory with the ground truth: ATE after Sim3 alignment, joined and map by map, and RPE.\n"
      "Exit code: 0 done, 1 no comparison possible (bad file, no common times), 2 bad arguments.");
  app.set_version_flag("--version", "portolan_eval " + BuildDescription());
  Arguments arguments;
  Declare(&app, &arguments);
  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  const Result<EvaluationOptions> options = ParseOptions(arguments);
  if (!options) return Complain(options.error(), kExitUsage);
  const Result<Evaluation> evaluation = Evaluate(arguments, *options);
  if (!evaluation) return Complain(evaluation.error(), kExitFailure);
  if (Status written = WriteOutputs(arguments, *evaluation); !written) return Complain(written.error(), kExitFailure);
  return 0;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  return portolan::Main(argc, argv);
}
