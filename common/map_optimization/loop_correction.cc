#include "map_optimization/loop_correction.h"

#include <algorithm>
#include <string>
#include <unordered_map>
#include <unordered_set>

#include "base/time.h"
#include "map_optimization/correction_steps.h"
#include "map_optimization/depth_ratio.h"
#include "map_optimization/map_correction.h"
#include "map_optimization/window_problem.h"

namespace portolan {
namespace {

using KeyFrameSet = std::unordered_set<KeyFrameId>;

// Keyframes that hold the welded window: one the frame, a second the scale.
constexpr size_t kMinFixed = 2;

bool IsRaised(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

Status CheckLoop(const Map& map, const LoopClosure& loop) {
  const std::string name = "loop of " + ToString(loop.current) + " and " + ToString(loop.matched);
  if (loop.current == loop.matched) return Error{name + ": one keyframe"};
  for (const KeyFrameId id : {loop.current, loop.matched}) {
    if (map.FindKeyFrame(id) == nullptr) return Error{name + ": " + ToString(id) + " is not in the map"};
  }
  if (!IsSimilarity(loop.current_from_matched)) {
    return Error{name + ": current_from_matched is no similarity, scale " +
                 std::to_string(loop.current_from_matched.scale)};
  }
  return Ok{};
}

/// The keyframe and its neighbours, best first, without those in `others`.
std::vector<KeyFrameId> Neighbourhood(const Map& map, KeyFrameId middle, int min_common, int most,
                                      const KeyFrameSet& others) {
  std::vector<KeyFrameId> ids = {middle};
  for (const auto& [id, common] : map.CovisibleKeyFrames(middle, min_common)) {
    if (ids.size() >= static_cast<size_t>(most)) break;
    if (others.count(id) == 0) ids.push_back(id);
  }
  return ids;
}

bool IsSeenBy(const MapPoint& point, const KeyFrameSet& keyframes) {
  return std::any_of(point.observations.begin(), point.observations.end(),
                     [&](const Observation& o) { return keyframes.count(o.keyframe) == 1; });
}

/// The steps of CorrectLoop, in order, and what they hand on.
class LoopCorrector {
 public:
  LoopCorrector(const Map& map, const LoopClosure& loop, const CorrectionFrame& frame,
                const LoopCorrectionOptions& options, const std::atomic<bool>* stop)
      : before_(map), loop_(loop), frame_(frame), options_(options), stop_(stop), map_(map) {
    matched_side_ = Neighbourhood(map, loop.matched, options.min_common, options.max_matched_side, {loop.current});
    in_matched_side_.insert(matched_side_.begin(), matched_side_.end());
    KeyFrameSet others = frame.held;
    others.insert(matched_side_.begin(), matched_side_.end());
    window_ = Neighbourhood(map, loop.current, options.min_common, options.max_window, others);
    in_window_.insert(window_.begin(), window_.end());
  }

  void CorrectWindow();
  Status FuseDuplicates();
  Status Weld();
  Status OptimizeGraph();
  MapCorrection MakeCorrection() const;
  Error Interrupted() const { return Failed("interrupted"); }

 private:
  Error Failed(const std::string& reason) const { return Error{frame_.kind + " correction: " + reason}; }
  void FuseGiven();
  void TakeWelded(const WindowProblem& solved);
  int CountWelded() const;
  void AddLoopEdges();
  MapPointId FinalId(MapPointId id) const;
  bool IsWelded(MapPointId id) const;
  bool IsGivenOut(const MapPoint& point) const;
  Eigen::Vector3f FinalPosition(const MapPoint& point) const;

  const Map& before_;
  const LoopClosure& loop_;
  const CorrectionFrame& frame_;
  const LoopCorrectionOptions& options_;
  const std::atomic<bool>* stop_;
  Map map_;  // corrected step by step
  std::vector<KeyFrameId> window_, matched_side_;
  KeyFrameSet in_window_, in_matched_side_;
  double scale_ = 1;  // units of the window before, for one of the matched side
  FusionResult fused_;
  std::unordered_map<MapPointId, MapPointId> merged_into_;
  std::vector<MapPointId> welded_points_;
  std::unordered_map<KeyFrameId, Sim3d> welded_;  // similarities of both sides after welding
  EssentialGraph graph_;
  std::vector<std::pair<KeyFrameId, KeyFrameId>> loop_edges_;
};

void LoopCorrector::CorrectWindow() {
  const Rigid3d old_current = before_.keyframe(loop_.current).camera_from_map;
  const Sim3d current_from_map = loop_.current_from_matched * Sim3d(before_.keyframe(loop_.matched).camera_from_map);
  scale_ = current_from_map.scale;
  for (const KeyFrameId id : window_) {
    const Sim3d own_from_current(before_.keyframe(id).camera_from_map * old_current.Inverse());
    map_.SetPose(id, MakeRigid(own_from_current * current_from_map));  // paper Eq. (13), S_i = S_ic S_c
  }
  // Paper Eq. (14), S_i^-1 T_i p, is S_c^-1 T_c p for every keyframe i of the window: S_i = T_i T_c^-1 S_c.
  const Sim3d new_from_old = current_from_map.Inverse() * Sim3d(old_current);
  for (const MapPointId id : LandmarksOf(before_, window_)) {
    const MapPoint& point = before_.point(id);
    if (IsSeenBy(point, in_matched_side_)) continue;
    const Eigen::Vector3f moved = (new_from_old * point.position_in_map.cast<double>()).cast<float>();
    if (moved.allFinite()) map_.SetPosition(id, moved);
  }
}

/// What verification found.
void LoopCorrector::FuseGiven() {
  const auto merge = [&](MapPointId from, MapPointId into) {
    if (from == into || map_.FindPoint(from) == nullptr || map_.FindPoint(into) == nullptr) return;
    map_.MergePoints(from, into);
    fused_.merges.emplace_back(from, into);
  };
  for (const auto& [from, into] : loop_.merges) merge(from, into);
  for (const auto& [feature, id] : loop_.seen) {
    const KeyFrame& current = map_.keyframe(loop_.current);
    if (feature >= current.landmarks.num_features() || map_.FindPoint(id) == nullptr) continue;
    if (current.landmarks[feature].IsValid()) {
      merge(current.landmarks[feature], id);
    } else if (map_.AddObservation(id, loop_.current, feature)) {
      fused_.observations.emplace_back(id, Observation{loop_.current, feature});
    }
  }
}

Status LoopCorrector::FuseDuplicates() {
  FuseGiven();
  // Derived fields of the matched side's landmarks are still as they were, which is right: nothing there has moved.
  const std::vector<MapPointId> landmarks = LandmarksOf(map_, matched_side_);
  for (const KeyFrameId id : window_) {
    if (IsRaised(stop_)) return Interrupted();
    FuseIntoKeyFrame(&map_, id, landmarks, options_.search, &fused_);
  }
  for (const auto& [from, into] : fused_.merges) merged_into_.emplace(from, into);
  return Ok{};
}

Status LoopCorrector::Weld() {
  BundleWindow window;
  window.free = window_;
  window.points = LandmarksOf(map_, window_);
  KeyFrameSet observers;
  for (const MapPointId id : window.points) {
    for (const Observation& o : map_.point(id).observations) observers.insert(o.keyframe);
  }
  for (const KeyFrameId id : matched_side_) {
    if (observers.count(id) == 1) window.fixed.push_back(id);
  }
  if (window.fixed.size() < kMinFixed) {
    return Failed(std::to_string(window.fixed.size()) + " keyframes of the matched side see what the " +
                  std::to_string(window_.size()) + " around the current one see, expected at least 2");
  }
  WindowProblem problem = MakeWindowProblem(map_, window);
  BundleOptions bundle;
  bundle.max_iterations = options_.bundle_iterations;
  const BundleSummary summary = AdjustBundle(&problem.problem, bundle, stop_);
  if (summary.interrupted) return Interrupted();
  if (!summary.converged_or_stopped) return Failed("the welding BA failed");
  TakeSolution(window, problem, &map_);
  RemoveOutliers(problem, options_.bundle_chi2, &map_);
  TakeWelded(problem);
  if (const int welded = CountWelded(); welded < options_.min_welded_landmarks) {
    return Failed("both sides see " + std::to_string(welded) + " landmarks after the welding BA, expected at least " +
                  std::to_string(options_.min_welded_landmarks));
  }
  return Ok{};
}

void LoopCorrector::TakeWelded(const WindowProblem& solved) {
  for (const MapPointId id : solved.points) {
    if (map_.FindPoint(id) != nullptr) welded_points_.push_back(id);
  }
  const std::unordered_set<MapPointId> points(welded_points_.begin(), welded_points_.end());
  for (const KeyFrameId id : window_) {
    const double scale = DepthRatio(before_, map_, id, points, scale_);
    const Rigid3d& rigid = map_.keyframe(id).camera_from_map;
    welded_.emplace(id, Sim3d(scale, rigid.rotation, scale * rigid.translation));
  }
  for (const KeyFrameId id : matched_side_) welded_.emplace(id, Sim3d(map_.keyframe(id).camera_from_map));
}

bool LoopCorrector::IsWelded(MapPointId id) const {
  const MapPoint* point = map_.FindPoint(id);
  return point != nullptr && IsSeenBy(*point, in_window_) && IsSeenBy(*point, in_matched_side_);
}

/// The welding BA knows better than the map before where a point is, if it saw what was seen of it. Seen by others too,
/// the point lies at the rim of the window and loses more than it gains: it follows its keyframe instead.
bool LoopCorrector::IsGivenOut(const MapPoint& point) const {
  const auto is_inside = [&](const Observation& o) { return welded_.count(o.keyframe) == 1; };
  return IsWelded(point.id) ||
         (IsSeenBy(point, in_window_) && std::all_of(point.observations.begin(), point.observations.end(), is_inside));
}

int LoopCorrector::CountWelded() const {
  return static_cast<int>(
      std::count_if(welded_points_.begin(), welded_points_.end(), [&](MapPointId id) { return IsWelded(id); }));
}

void LoopCorrector::AddLoopEdges() {
  for (const KeyFrameId i : window_) {
    for (const KeyFrameId j : matched_side_) {
      const bool is_the_loop = i == loop_.current && j == loop_.matched;
      if (!is_the_loop && map_.Covisibility(i, j) < options_.min_loop_common) continue;
      graph_.AddEdge(j, i, welded_.at(i) * welded_.at(j).Inverse(),
                     std::max(map_.Covisibility(i, j), options_.min_loop_common));
      loop_edges_.emplace_back(i, j);
    }
  }
}

Status LoopCorrector::OptimizeGraph() {
  graph_ = MakeEssentialGraph(before_, loop_.earlier_edges, options_.graph);
  for (const KeyFrameId id : frame_.held) graph_.graph.nodes[graph_.IndexOf(id)].fixed = true;
  std::vector<bool> is_welded(graph_.keyframes.size(), false);
  for (const KeyFrameId id : window_) {
    PoseGraph::Node& node = graph_.graph.nodes[graph_.IndexOf(id)];
    is_welded[graph_.IndexOf(id)] = true;
    node.camera_from_map = welded_.at(id);
    node.fixed = false;  // if even the map's first keyframe moves, the matched one holds the frame instead
    if (!before_.keyframe(id).parent.IsValid()) graph_.graph.nodes[graph_.IndexOf(loop_.matched)].fixed = true;
  }
  for (PoseGraph::Edge& e : graph_.graph.edges) {
    if (!is_welded[e.i] || !is_welded[e.j]) continue;
    e.j_from_i = graph_.graph.nodes[e.j].camera_from_map * graph_.graph.nodes[e.i].camera_from_map.Inverse();
  }
  AddLoopEdges();
  const PoseGraphSummary summary = OptimizePoseGraph(&graph_.graph, PoseGraphOptions(), stop_);
  if (summary.interrupted) return Interrupted();
  if (!summary.converged_or_stopped) return Failed("the pose graph could not be optimised");
  return Ok{};
}

MapPointId LoopCorrector::FinalId(MapPointId id) const {
  for (auto next = merged_into_.find(id); next != merged_into_.end(); next = merged_into_.find(id)) id = next->second;
  return id;
}

/// Where the pose graph takes a welded point: it follows the nearest keyframe of the two sides that sees it.
Eigen::Vector3f LoopCorrector::FinalPosition(const MapPoint& point) const {
  const Eigen::Vector3d position = point.position_in_map.cast<double>();
  KeyFrameId nearest;
  double least = 0;
  for (const Observation& o : point.observations) {
    if (welded_.count(o.keyframe) == 0) continue;
    const double distance = (map_.keyframe(o.keyframe).camera_from_map * position).squaredNorm();
    if (nearest.IsValid() && distance >= least) continue;
    nearest = o.keyframe;
    least = distance;
  }
  return (graph_.camera_from_map(nearest).Inverse() * (welded_.at(nearest) * position)).cast<float>();
}

MapCorrection LoopCorrector::MakeCorrection() const {
  MapCorrection correction = EmptyCorrection(before_, frame_.kind);
  for (const KeyFrameId id : graph_.keyframes) {
    if (frame_.held.count(id) == 0) correction.keyframes.push_back({id, graph_.camera_from_map(id)});
  }
  for (const MapPointId id : welded_points_) {
    const MapPoint& point = map_.point(id);
    if (!IsGivenOut(point)) continue;
    const Eigen::Vector3f position = FinalPosition(point);
    if (position.allFinite()) correction.points.push_back({id, position});
  }
  // What the welding BA found to be outliers on either side is no duplicate.
  for (const auto& [from, into] : fused_.merges) {
    if (IsWelded(FinalId(into))) correction.merges.emplace_back(from, into);
  }
  for (const auto& [id, seen] : fused_.observations) {
    const MapPoint* point = map_.FindPoint(FinalId(id));
    const Observation* kept = point != nullptr ? point->FindObservation(seen.keyframe) : nullptr;
    if (kept != nullptr && kept->feature == seen.feature) correction.observations.emplace_back(point->id, seen);
  }
  correction.loop_edges = loop_edges_;
  return correction;
}

}  // namespace

Result<MapCorrection> CorrectLoop(const Map& map, const LoopClosure& loop, const LoopCorrectionOptions& options,
                                  const std::atomic<bool>* stop, StageTimes* times) {
  return CorrectLoop(map, loop, CorrectionFrame(), options, stop, times);
}

Result<MapCorrection> CorrectLoop(const Map& map, const LoopClosure& loop, const CorrectionFrame& frame,
                                  const LoopCorrectionOptions& options, const std::atomic<bool>* stop,
                                  StageTimes* times) {
  if (Status checked = CheckLoop(map, loop); !checked.ok()) return checked.error();
  Stopwatch watch;
  const auto end_stage = [&](const char* stage) {
    if (times != nullptr) times->Add(frame.kind + stage, watch.Milliseconds());
    watch.Restart();
  };
  LoopCorrector corrector(map, loop, frame, options, stop);
  corrector.CorrectWindow();
  end_stage("_window");
  Status status = corrector.FuseDuplicates();
  end_stage("_fusion");
  if (status.ok()) {
    status = corrector.Weld();
    end_stage("_welding");
  }
  if (status.ok()) {
    status = corrector.OptimizeGraph();
    end_stage("_graph");
  }
  if (status.ok() && IsRaised(stop)) status = corrector.Interrupted();
  if (!status.ok()) return status.error();
  return corrector.MakeCorrection();
}

}  // namespace portolan
