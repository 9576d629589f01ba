#include "map/covisibility_graph.h"

#include <algorithm>

#include "base/check.h"

namespace portolan {
namespace {

/// Where the keyframe is in the list, or would be.
template <class List>
auto Place(List& list, KeyFrameId id) {
  return std::lower_bound(list.begin(), list.end(), id,
                          [](const auto& neighbour, KeyFrameId wanted) { return neighbour.first < wanted; });
}

void AddTo(CovisibilityGraph::Neighbours* list, KeyFrameId id) {
  const auto place = Place(*list, id);
  if (place != list->end() && place->first == id) {
    ++place->second;
  } else {
    list->insert(place, {id, 1});
  }
}

void RemoveFrom(CovisibilityGraph::Neighbours* list, KeyFrameId id) {
  const auto place = Place(*list, id);
  PORTOLAN_CHECK(place != list->end() && place->first == id) << "no common point with keyframe " << id;
  if (--place->second == 0) list->erase(place);
}

}  // namespace

void CovisibilityGraph::Fill(const std::vector<KeyFrameId>& keyframes,
                             const std::vector<std::vector<uint32_t>>& seen_by) {
  PORTOLAN_CHECK(IsEmpty());
  std::vector<std::vector<size_t>> points(keyframes.size());  // that a keyframe sees
  for (size_t point = 0; point < seen_by.size(); ++point) {
    for (const uint32_t keyframe : seen_by[point]) points[keyframe].push_back(point);
  }
  std::vector<int> common(keyframes.size());
  for (size_t of = 0; of < keyframes.size(); ++of) {
    std::fill(common.begin(), common.end(), 0);
    for (const size_t point : points[of]) {
      for (const uint32_t keyframe : seen_by[point]) ++common[keyframe];
    }
    common[of] = 0;
    const auto count = common.size() - static_cast<size_t>(std::count(common.begin(), common.end(), 0));
    if (count == 0) continue;
    Neighbours& neighbours = neighbours_[keyframes[of]];
    neighbours.reserve(count);
    for (size_t other = 0; other < common.size(); ++other) {
      if (common[other] > 0) neighbours.emplace_back(keyframes[other], common[other]);
    }
  }
}

void CovisibilityGraph::Add(KeyFrameId a, KeyFrameId b) {
  AddTo(&neighbours_[a], b);
  AddTo(&neighbours_[b], a);
}

void CovisibilityGraph::Remove(KeyFrameId a, KeyFrameId b) {
  RemoveFrom(&neighbours_[a], b);
  RemoveFrom(&neighbours_[b], a);
}

void CovisibilityGraph::Forget(KeyFrameId id) {
  PORTOLAN_CHECK(Of(id).empty()) << "keyframe " << id << " has neighbours";
  neighbours_.erase(id);
}

bool CovisibilityGraph::IsEmpty() const {
  return std::all_of(neighbours_.begin(), neighbours_.end(), [](const auto& entry) { return entry.second.empty(); });
}

int CovisibilityGraph::Common(KeyFrameId a, KeyFrameId b) const {
  const Neighbours& list = Of(a);
  const auto place = Place(list, b);
  return place != list.end() && place->first == b ? place->second : 0;
}

const CovisibilityGraph::Neighbours& CovisibilityGraph::Of(KeyFrameId id) const {
  static const Neighbours kNone;
  const auto found = neighbours_.find(id);
  return found == neighbours_.end() ? kNone : found->second;
}

}  // namespace portolan
