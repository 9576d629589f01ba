#pragma once

#include <utility>
#include <vector>

#include "base/ids.h"
#include "map/map.h"
#include "mapping/mapper_options.h"

namespace portolan {

/// Landmarks too young to be trusted. A new one must be seen by probation_observations keyframes by the time
/// probation_keyframes more are in the map, or it goes; it is judged one keyframe earlier already if it was predicted
/// visible in a later keyframe. That is stricter and sooner than the paper's rule (two measurements, predicted visible
/// in more than ten), because a wrong point harms tracking most while it is new.
class PointProbation {
 public:
  explicit PointProbation(const PruningOptions& options) : options_(options) {}

  /// Points just created.
  void Add(const std::vector<MapPointId>& points);
  /// One more keyframe is in the map, with its observations. @return points that failed, for the caller to remove;
  /// those that passed or are gone are forgotten. Derived fields of the map's points must be up to date.
  std::vector<MapPointId> Judge(const Map& map, KeyFrameId newest);
  size_t size() const { return entries_.size(); }

 private:
  struct Entry {
    MapPointId point;
    int age = 0;      // keyframes since
    int visible = 0;  // of those, predicted to show the point
  };
  PruningOptions options_;
  std::vector<Entry> entries_;
};

/// Landmarks of the keyframe's neighbourhood that have only two measurements but are predicted to be visible in more
/// than options.unreliable_visible keyframes of it (paper Sec. 4.2). Derived fields must be up to date.
std::vector<MapPointId> FindUnreliablePoints(const Map& map, KeyFrameId keyframe, const PruningOptions& options);

/// Whether at least options.redundant_share of the keyframe's landmarks are seen in options.redundant_observers other
/// keyframes (paper Sec. 4.2), at the same or a finer scale (one octave of slack): what it knows, others know as well.
bool IsRedundant(const Map& map, KeyFrameId keyframe, const PruningOptions& options);

/// Removes redundant keyframes among those covisible with `newest`, weakest link first; never the map's first nor the
/// options.keep_newest last.
/// @return those removed, each with the parent that stands for it.
std::vector<std::pair<KeyFrameId, KeyFrameId>> PruneKeyFrames(Map* map, KeyFrameId newest,
                                                              const PruningOptions& options);

}  // namespace portolan
