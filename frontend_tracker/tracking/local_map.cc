#include "tracking/local_map.h"

#include <algorithm>
#include <map>
#include <unordered_map>
#include <unordered_set>

namespace portolan {
namespace {

// Covisible keyframes added for each keyframe that shares landmarks with the frame.
constexpr size_t kNeighboursEach = 10;

/// Keyframes by number of the given landmarks that they see, most first, then by id.
std::vector<std::pair<KeyFrameId, int>> Vote(const Map& map, const std::vector<MapPointId>& landmarks) {
  std::unordered_map<KeyFrameId, int> votes;
  for (const MapPointId id : landmarks) {
    const MapPoint* point = id.IsValid() ? map.FindPoint(id) : nullptr;
    if (point == nullptr) continue;
    for (const Observation& o : point->observations) ++votes[o.keyframe];
  }
  std::vector<std::pair<KeyFrameId, int>> sorted(votes.begin(), votes.end());
  std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) {
    return a.second != b.second ? a.second > b.second : b.first < a.first;  // of equals the younger
  });
  return sorted;
}

}  // namespace

void LocalMap::Update(const Map& map, const std::vector<MapPointId>& landmarks, int max_keyframes) {
  SelectKeyFrames(map, landmarks, max_keyframes);
  std::vector<KeyFrameId> sorted = keyframes_;
  std::sort(sorted.begin(), sorted.end());
  if (sorted == collected_keyframes_ && collected_map_ == map.id() && collected_revision_ == map.revision()) return;
  CollectLandmarks(map);
  collected_keyframes_ = std::move(sorted);
  collected_map_ = map.id();
  collected_revision_ = map.revision();
}

void LocalMap::SelectKeyFrames(const Map& map, const std::vector<MapPointId>& landmarks, int max_keyframes) {
  keyframes_.clear();
  const auto votes = Vote(map, landmarks);
  reference_ = votes.empty() ? KeyFrameId() : votes.front().first;
  const size_t most = static_cast<size_t>(max_keyframes);
  std::unordered_set<KeyFrameId> taken;
  const auto take = [&](KeyFrameId id) {
    if (keyframes_.size() < most && taken.insert(id).second) keyframes_.push_back(id);
  };
  // Half of the room at most for direct neighbours, so that theirs find a place.
  for (size_t i = 0; i < votes.size() && i < (most + 1) / 2; ++i) take(votes[i].first);
  const size_t direct = keyframes_.size();
  for (size_t i = 0; i < direct && keyframes_.size() < most; ++i) {
    for (const auto& [neighbour, common] : map.CovisibleKeyFrames(keyframes_[i], 15, kNeighboursEach)) take(neighbour);
  }
}

void LocalMap::CollectLandmarks(const Map& map) {
  landmarks_.clear();
  std::unordered_set<MapPointId> taken;
  for (const KeyFrameId id : keyframes_) {
    for (const MapPointId landmark : map.keyframe(id).landmarks) {
      if (!taken.insert(landmark).second) continue;
      const MapPoint& point = map.point(landmark);
      landmarks_.push_back({landmark, point.position_in_map.cast<double>(), point.mean_viewing_direction,
                            point.min_distance, point.max_distance, point.descriptor});
    }
  }
}

}  // namespace portolan
