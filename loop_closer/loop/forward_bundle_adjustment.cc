#include "loop/forward_bundle_adjustment.h"

#include <algorithm>
#include <deque>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "base/time.h"
#include "map_optimization/map_correction.h"
#include "optimization/pose_graph.h"
#include "vocabulary/bow_vector.h"

namespace portolan {
namespace {

/// The places of a map's keyframes in order of age, and which of them are taken.
class SparseChoice {
 public:
  SparseChoice(const Map& map, int min_apart) : min_apart_(min_apart) {
    int place = 0;
    for (const auto& [id, keyframe] : map.keyframes()) places_.emplace(id, place++);
  }
  bool IsApart(KeyFrameId id) const {
    const int place = places_.at(id);
    const auto next = taken_.lower_bound(place - min_apart_ + 1);
    return next == taken_.end() || *next >= place + min_apart_;
  }
  void Take(KeyFrameId id) { taken_.insert(places_.at(id)); }

 private:
  int min_apart_;
  std::unordered_map<KeyFrameId, int> places_;
  std::set<int> taken_;
};

/// Everything else finds its place between the adjusted keyframes.
Status SpreadCorrection(const std::unordered_map<KeyFrameId, Sim3d>& adjusted, EssentialGraph* graph,
                        const std::atomic<bool>* stop) {
  for (size_t k = 0; k < graph->keyframes.size(); ++k) {
    const auto found = adjusted.find(graph->keyframes[k]);
    graph->graph.nodes[k].fixed = found != adjusted.end();
    if (found != adjusted.end()) graph->graph.nodes[k].camera_from_map = found->second;
  }
  const PoseGraphSummary summary = OptimizePoseGraph(&graph->graph, PoseGraphOptions(), stop);
  if (summary.interrupted) return Error{"interrupted"};
  if (!summary.converged_or_stopped) return Error{"the pose graph could not be optimised"};
  return Ok{};
}

}  // namespace

std::vector<KeyFrameId> FindForwardPoseTree(const Map& map, KeyFrameId current, const ForwardBundleOptions& options) {
  SparseChoice choice(map, options.min_apart);
  choice.Take(current);
  std::vector<KeyFrameId> tree = {current};
  std::unordered_set<KeyFrameId> reached = {current};
  std::deque<std::pair<KeyFrameId, KeyFrameId>> open = {
      {current, current}};  // keyframe, last one of the tree before it
  for (; !open.empty(); open.pop_front()) {
    const auto [keyframe, last] = open.front();
    const BowVector& last_bow = map.keyframe(last).data->bow;
    for (const auto& [next, common] : map.CovisibleKeyFrames(keyframe, 1)) {
      if (reached.count(next) == 1) continue;
      if (CountCommonWords(map.keyframe(next).data->bow, last_bow) <= options.min_common_words) continue;
      reached.insert(next);
      const bool is_of_the_tree = choice.IsApart(next);
      if (is_of_the_tree) {
        choice.Take(next);
        tree.push_back(next);
      }
      open.emplace_back(next, is_of_the_tree ? next : last);
    }
  }
  return tree;
}

Result<MapCorrection> AdjustForward(const Map& map, KeyFrameId current,
                                    const std::vector<std::pair<KeyFrameId, KeyFrameId>>& loop_edges,
                                    const ForwardBundleOptions& options, const std::atomic<bool>* stop,
                                    StageTimes* times, std::optional<LossChange>* losses) {
  const Stopwatch watch;
  if (map.FindKeyFrame(current) == nullptr) return Error{"FBA: keyframe " + ToString(current) + " is not in the map"};
  std::vector<KeyFrameId> tree = FindForwardPoseTree(map, current, options);
  std::sort(tree.begin(), tree.end());  // BA fixes the oldest
  auto adjusted = AdjustKeyFrames(map, tree, options.adjustment, stop);
  if (!adjusted.ok()) return Error{"FBA: " + adjusted.error().message};

  EssentialGraph graph = MakeEssentialGraph(map, loop_edges, options.graph);
  if (Status spread = SpreadCorrection(adjusted->camera_from_map, &graph, stop); !spread.ok()) {
    return Error{"FBA: " + spread.error().message};
  }
  MapCorrection correction = EmptyCorrection(map, "fba");
  for (const KeyFrameId id : graph.keyframes) correction.keyframes.push_back({id, graph.camera_from_map(id)});
  correction.points = std::move(adjusted->points);
  // None is held: those of the tree, too, fit in better with all that they see than with what BA used of it.
  if (Status done = CompleteCorrection(map, {}, options.adjustment.followers, stop, &correction, losses); !done.ok()) {
    return Error{"FBA: " + done.error().message};
  }
  if (times != nullptr) times->Add("fba", watch.Milliseconds());
  return correction;
}

}  // namespace portolan
