#include "mapping/pruning.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "map/keyframe_view.h"
#include "mapping/newest_keyframes.h"

namespace portolan {
namespace {

// A keyframe one octave coarser still serves as well as the one to be pruned.
constexpr int kOctaveSlack = 1;

/// Whether enough others see the landmark at the keyframe's scale or finer.
bool IsSeenByOthers(const Map& map, const MapPoint& point, KeyFrameId keyframe, int octave, int observers) {
  if (static_cast<int>(point.observations.size()) <= observers) return false;
  int others = 0;
  for (const Observation& o : point.observations) {
    if (o.keyframe == keyframe) continue;
    if (map.keyframe(o.keyframe).data->features.octaves[o.feature] > octave + kOctaveSlack) continue;
    if (++others >= observers) return true;
  }
  return false;
}

}  // namespace

void PointProbation::Add(const std::vector<MapPointId>& points) {
  for (const MapPointId id : points) entries_.push_back(Entry{id});
}

std::vector<MapPointId> PointProbation::Judge(const Map& map, KeyFrameId newest) {
  const KeyFrameView view(map.keyframe(newest));
  std::vector<MapPointId> failed;
  std::vector<Entry> still;
  for (Entry entry : entries_) {
    const MapPoint* point = map.FindPoint(entry.point);
    if (point == nullptr) continue;
    ++entry.age;
    if (view.Predict(*point)) ++entry.visible;
    const bool was_missed = entry.age + 1 >= options_.probation_keyframes && entry.visible > 0;
    if (entry.age < options_.probation_keyframes && !was_missed) {
      still.push_back(entry);
    } else if (static_cast<int>(point->observations.size()) < options_.probation_observations) {
      failed.push_back(entry.point);
    }
  }
  entries_ = std::move(still);
  return failed;
}

std::vector<MapPointId> FindUnreliablePoints(const Map& map, KeyFrameId keyframe, const PruningOptions& options) {
  std::vector<KeyFrameView> views;
  views.emplace_back(map.keyframe(keyframe));
  std::set<MapPointId> weak;
  for (const auto& [id, common] : map.CovisibleKeyFrames(keyframe, 1, static_cast<size_t>(options.max_checked))) {
    views.emplace_back(map.keyframe(id));
    for (const MapPointId landmark : map.keyframe(id).landmarks) {
      if (map.point(landmark).observations.size() <= 2) weak.insert(landmark);
    }
  }
  std::vector<MapPointId> unreliable;
  for (const MapPointId id : weak) {
    const MapPoint& point = map.point(id);
    int visible = 0;
    for (const KeyFrameView& view : views) visible += view.Predict(point).has_value() ? 1 : 0;
    if (visible > options.unreliable_visible) unreliable.push_back(id);
  }
  return unreliable;
}

bool IsRedundant(const Map& map, KeyFrameId keyframe, const PruningOptions& options) {
  const KeyFrame& candidate = map.keyframe(keyframe);
  const auto total = std::distance(candidate.landmarks.begin(), candidate.landmarks.end());
  // It stops as soon as more landmarks than this are its own.
  const double own_allowed = (1.0 - options.redundant_share) * static_cast<double>(total);
  int own = 0;
  const std::vector<MapPointId> landmarks = candidate.landmarks.ByFeature();
  for (size_t feature = 0; feature < landmarks.size(); ++feature) {
    if (!landmarks[feature].IsValid()) continue;
    const int octave = candidate.data->features.octaves[feature];
    if (IsSeenByOthers(map, map.point(landmarks[feature]), keyframe, octave, options.redundant_observers)) continue;
    if (++own > own_allowed) return false;
  }
  return total > 0;
}

std::vector<std::pair<KeyFrameId, KeyFrameId>> PruneKeyFrames(Map* map, KeyFrameId newest,
                                                              const PruningOptions& options) {
  std::vector<std::pair<KeyFrameId, KeyFrameId>> removed;
  const std::vector<KeyFrameId> newest_few = NewestKeyFrames(*map, static_cast<size_t>(options.keep_newest));
  const std::set<KeyFrameId> kept(newest_few.begin(), newest_few.end());
  auto candidates = map->CovisibleKeyFrames(newest, 1, static_cast<size_t>(options.max_checked));
  std::reverse(candidates.begin(), candidates.end());
  for (const auto& [id, common] : candidates) {
    if (kept.count(id) > 0 || id == newest || !map->keyframe(id).parent.IsValid()) continue;
    if (!IsRedundant(*map, id, options)) continue;
    removed.emplace_back(id, map->keyframe(id).parent);
    map->RemoveKeyFrame(id);
  }
  if (!removed.empty()) map->RefreshDerived();
  return removed;
}

}  // namespace portolan
