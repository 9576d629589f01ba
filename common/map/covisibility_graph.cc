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
