// portolan_place_precision: asks of each keyframe of finished maps (portolan_pipeline_run --save-maps) for its
// candidates among the older ones, verifies them and compares with the ground truth. Prints a line a candidate, then
// precision, recall by revisit and times.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <map>
#include <optional>
#include <set>

#include "base/command_line.h"
#include "base/time.h"
#include "dataset/trajectory_evaluation.h"
#include "dataset/trajectory_io.h"
#include "pipeline/map_file.h"
#include "place_recognition/candidates.h"
#include "place_recognition/sim3_verification.h"

namespace portolan {
namespace {

// A pair is a true revisit when the cameras are near for what they look at; in between it is neither.
constexpr double kNearDepths = 0.5, kFarDepths = 2;  // of the query's median depth
constexpr double kNearDeg = 40, kFarDeg = 75;
// A verified similarity is right when it puts the candidate where the ground truth has it.
constexpr double kRightDeg = 8, kRightDepths = 0.25;

struct Arguments {
  std::string truth;
  std::vector<std::string> maps;
  std::vector<std::string> revisits;  ///< "first-last" frames of a second visit
  int min_age = 20;                   ///< keyframes
  bool lenient = false;
};

/// The ground truth of two keyframes, beside what was found.
struct Comparison {
  double distance_m = 0, angle_deg = 0, depth_m = 0;
  double rotation_error_deg = 0, translation_error_m = 0;

  const char* Label() const {
    if (distance_m < kNearDepths * depth_m && angle_deg < kNearDeg) return "true";
    return distance_m > kFarDepths * depth_m || angle_deg > kFarDeg ? "false" : "between";
  }
  bool IsRight() const { return rotation_error_deg < kRightDeg && translation_error_m < kRightDepths * depth_m; }
};

struct Counts {
  int candidates = 0, verified = 0, wrong = 0;
  std::map<std::string, std::pair<int, int>> by_label;  ///< candidates, verified
};

double Degrees(double radians) {
  return radians * 180 / M_PI;
}

class Precision {
 public:
  Precision(std::map<MapId, Map> maps, const Trajectory& truth, const Arguments& arguments)
      : maps_(std::move(maps)), arguments_(arguments) {
    for (const TrajectoryPose& pose : truth) truth_[pose.stamp] = pose.world_from_camera;
    max_dt_ = HalfMedianInterval(truth);
    if (arguments.lenient) {
      options_.min_inliers = options_.ransac.min_inliers = 12;
      options_.min_group_inliers = options_.min_expected = options_.min_agreeing = 0;
      options_.min_share = options_.min_spread = options_.min_weight = 0;
    }
  }

  /// From the youngest keyframe to the oldest: each is asked, then taken out, so that the map is as it was when it
  /// came.
  void Run() {
    for (auto map = maps_.begin(); map != maps_.end();) {
      for (const auto& [keyframe, state] : map->second.keyframes()) index_.Add(keyframe, WordsOf(state.data));
      map = map->second.keyframes().empty() ? maps_.erase(map) : std::next(map);
    }
    while (!maps_.empty()) {
      const auto youngest = std::max_element(maps_.begin(), maps_.end(), [](const auto& a, const auto& b) {
        return a.second.keyframes().rbegin()->second.data->stamp < b.second.keyframes().rbegin()->second.data->stamp;
      });
      Map& map = youngest->second;
      const KeyFrameId query = map.keyframes().rbegin()->first;
      map.RefreshDerived();
      Ask(map, query);
      index_.Remove(query);
      if (map.keyframes().size() > 1)
        map.RemoveKeyFrame(query);
      else
        maps_.erase(youngest);
    }
  }

  void Report() const {
    fmt::print("\n{} candidates, {} verified, {} of them wrong\n", counts_.candidates, counts_.verified, counts_.wrong);
    for (const auto& [label, count] : counts_.by_label)
      fmt::print("  {:8} {} candidates, {} verified\n", label, count.first, count.second);
    for (const std::string& revisit : arguments_.revisits) ReportRevisit(revisit);
    for (const auto& [stage, samples] : times_.samples()) {
      fmt::print("  {:18} {:5} x median {:5.2f} p95 {:5.2f} max {:5.2f} ms\n", stage, samples.size(),
                 Quantile(samples, 0.5), Quantile(samples, 0.95), Quantile(samples, 1));
    }
  }

 private:
  void Ask(const Map& map, KeyFrameId query) {
    const KeyFrameData& data = *map.keyframe(query).data;
    asked_.push_back(data.frame);
    for (const auto& [id, other] : maps_) {
      const auto is_excluded = [&](KeyFrameId k) {
        return id == map.id() && (map.Covisibility(query, k) > 0 ||
                                  k.sequence() + static_cast<uint32_t>(arguments_.min_age) > query.sequence());
      };
      Stopwatch watch;
      const std::vector<Candidate> candidates = FindCandidates(data.bow, index_, other, {}, is_excluded);
      times_.Add("candidates", watch.Milliseconds());
      for (const Candidate& candidate : candidates) Verify(map, query, other, candidate);
    }
  }

  void Verify(const Map& map, KeyFrameId query, const Map& other, const Candidate& candidate) {
    Stopwatch watch;
    const auto place = VerifyPlace(map, query, other, candidate.keyframe, options_, nullptr, &times_);
    times_.Add("verification", watch.Milliseconds());
    const auto comparison =
        Compare(map, query, other, candidate.keyframe, place.ok() ? place->query_from_candidate : Sim3d());
    if (!comparison) return;  // no ground truth here
    const KeyFrameData& a = *map.keyframe(query).data;
    const bool right = place.ok() && comparison->IsRight();
    ++counts_.candidates;
    auto& [of_label, verified] = counts_.by_label[comparison->Label()];
    ++of_label;
    if (place.ok()) {
      ++counts_.verified;
      ++verified;
      counts_.wrong += right ? 0 : 1;
      if (right) found_.push_back(a.frame);
    }
    fmt::print("frame {} candidate {} score {:.3f} {} distance {:.2f} m {:.0f} deg depth {:.1f} m: {}", a.frame,
               other.keyframe(candidate.keyframe).data->frame, candidate.accumulated_score, comparison->Label(),
               comparison->distance_m, comparison->angle_deg, comparison->depth_m,
               place.ok() ? right ? "RIGHT " : "WRONG " : "refused ");
    if (!place.ok())
      fmt::print("{}\n", place.error().message);
    else
      fmt::print("off {:.1f} deg {:.2f} m scale {:.2f}; {}\n", comparison->rotation_error_deg,
                 comparison->translation_error_m, place->query_from_candidate.scale, ToString(place->evidence));
  }

  const Rigid3d* TruthOf(const KeyFrame& keyframe) const {
    const Timestamp stamp = keyframe.data->stamp;
    auto next = truth_.lower_bound(stamp);
    if (next != truth_.begin()) {
      const auto last = std::prev(next);
      if (next == truth_.end() || SecondsBetween(last->first, stamp) < SecondsBetween(stamp, next->first)) next = last;
    }
    if (next == truth_.end() || std::abs(SecondsBetween(stamp, next->first)) > max_dt_) return nullptr;
    return &next->second;
  }

  /// Metres of a map unit around a keyframe: by its covisible keyframes. 0 if unknown.
  double MetresPerUnit(const Map& map, KeyFrameId id) const {
    const KeyFrame& keyframe = map.keyframe(id);
    const Rigid3d* here = TruthOf(keyframe);
    double metres = 0, units = 0;
    for (const auto& [neighbour, common] : map.CovisibleKeyFrames(id, 1, 20)) {
      const Rigid3d* there = TruthOf(map.keyframe(neighbour));
      if (here == nullptr || there == nullptr) continue;
      metres += (here->translation - there->translation).norm();
      units += (keyframe.camera_from_map * map.keyframe(neighbour).camera_from_map.Inverse()).translation.norm();
    }
    return units > 0 ? metres / units : 0;
  }

  std::optional<Comparison> Compare(const Map& map, KeyFrameId query, const Map& other, KeyFrameId candidate,
                                    const Sim3d& query_from_candidate) const {
    const Rigid3d* world_from_query = TruthOf(map.keyframe(query));
    const Rigid3d* world_from_candidate = TruthOf(other.keyframe(candidate));
    const double metres = MetresPerUnit(map, query);
    if (world_from_query == nullptr || world_from_candidate == nullptr || !(metres > 0)) return std::nullopt;
    const Rigid3d truth = world_from_query->Inverse() * *world_from_candidate;
    Comparison comparison;
    comparison.distance_m = truth.translation.norm();
    comparison.angle_deg = Degrees(std::acos(std::clamp((truth.rotation * Eigen::Vector3d::UnitZ()).z(), -1.0, 1.0)));
    comparison.depth_m = metres * map.MedianDepth(query);
    comparison.rotation_error_deg = Degrees(truth.rotation.angularDistance(query_from_candidate.rotation));
    comparison.translation_error_m = (metres * query_from_candidate.translation - truth.translation).norm();
    return comparison;
  }

  void ReportRevisit(const std::string& revisit) const {
    unsigned first = 0, last = 0;
    if (std::sscanf(revisit.c_str(), "%u-%u", &first, &last) != 2) return;
    const auto is_inside = [&](uint64_t frame) { return frame >= first && frame <= last; };
    const std::set<uint64_t> found(found_.begin(), found_.end());
    fmt::print("  revisit {}: {} of {} keyframes find it\n", revisit,
               std::count_if(found.begin(), found.end(), is_inside),
               std::count_if(asked_.begin(), asked_.end(), is_inside));
  }

  std::map<MapId, Map> maps_;
  const Arguments& arguments_;
  std::map<Timestamp, Rigid3d> truth_;  ///< world_from_camera
  double max_dt_ = 0;
  Sim3VerificationOptions options_;
  KeyFrameIndex index_;
  Counts counts_;
  std::vector<uint64_t> asked_, found_;  ///< frames of keyframes; those with a right place
  StageTimes times_;
};

Status Run(const Arguments& arguments) {
  const auto vocabulary = Vocabulary::Open(Vocabulary::DefaultPath());
  if (!vocabulary) return vocabulary.error();
  const std::string times = (std::filesystem::path(arguments.truth).parent_path() / "times.txt").string();
  const auto truth = ReadTrajectory(arguments.truth, std::filesystem::exists(times) ? times : "");
  if (!truth) return truth.error();
  std::map<MapId, Map> maps;
  for (const std::string& file : arguments.maps) {
    auto loaded = LoadMaps(file, **vocabulary);
    if (!loaded) return loaded.error();
    maps.merge(*loaded);
  }
  Precision precision(std::move(maps), *truth, arguments);
  precision.Run();
  precision.Report();
  return Ok{};
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  CLI::App app("Precision and recall of place verification on finished maps, against the ground truth",
               "portolan_place_precision");
  portolan::Arguments arguments;
  app.add_option("truth", arguments.truth, "TUM or KITTI ground truth")->required();
  app.add_option("maps", arguments.maps,
                 "of portolan_pipeline_run --save-maps; of several runs if their --session differs")
      ->required();
  app.add_option("--revisit", arguments.revisits, "frames of a second visit, FIRST-LAST (repeatable)");
  app.add_option("--min-age", arguments.min_age, "keyframes between the two at least, in one map")
      ->capture_default_str();
  app.add_flag("--lenient", arguments.lenient, "verify what has a similarity at all: for choosing bounds");
  if (const auto code = portolan::ParseCommandLine(&app, argc, argv)) return *code;
  const portolan::Status status = portolan::Run(arguments);
  if (!status) fmt::print(stderr, "portolan_place_precision: {}\n", status.error().message);
  return status.ok() ? 0 : 1;
}
