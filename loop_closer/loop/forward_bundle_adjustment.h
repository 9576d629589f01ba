#pragma once

#include <atomic>
#include <optional>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "base/statistics.h"
#include "map/map.h"
#include "map/protocol.h"
#include "map_optimization/essential_graph.h"
#include "map_optimization/keyframe_adjustment.h"

namespace portolan {

struct ForwardBundleOptions {
  int min_apart = 5;          ///< keyframes from one of the tree to the next, in order of age (paper)
  int min_common_words = 50;  ///< more than so many must a keyframe share with the last one of the tree (paper)
  KeyFrameAdjustmentOptions adjustment;
  EssentialGraphOptions graph;  ///< through which the other keyframes follow
};

/// The forward pose tree (paper Sec. 5): from the current keyframe along the pose graph, the next one at least five
/// keyframes apart from the last and with more than 50 common words, until none meets that. Of keyframes that meet it
/// the best covisible comes first; one that is less than five apart from any of the tree is only passed through, so
/// that the tree stays as sparse where ways meet.
/// @return its keyframes in order of discovery, the current one first.
std::vector<KeyFrameId> FindForwardPoseTree(const Map& map, KeyFrameId current, const ForwardBundleOptions& options);

/// Forward sparse global BA: BA over the keyframes of the tree and the landmarks that they share. The keyframes between
/// them get their share of the correction from the pose graph with the tree fixed, so that nothing tears; then all
/// keyframes and landmarks settle against each other (RefineFollowers). The map keeps its frame and scale.
/// @param loop_edges of loops closed earlier.
/// @return the proposal, kind "fba"; or why there is none: an unknown keyframe, too small a tree, no improvement over
/// all observations of the map, "interrupted". `stop` (may be null) ends it after the current iteration, without a
/// result. `times` (may be null) gets fba; `losses` (may be null): see CompleteCorrection. Deterministic.
Result<MapCorrection> AdjustForward(const Map& map, KeyFrameId current,
                                    const std::vector<std::pair<KeyFrameId, KeyFrameId>>& loop_edges,
                                    const ForwardBundleOptions& options, const std::atomic<bool>* stop,
                                    StageTimes* times, std::optional<LossChange>* losses = nullptr);

}  // namespace portolan
