#pragma once

#include <atomic>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "base/statistics.h"
#include "map/map.h"
#include "map/protocol.h"
#include "map_optimization/loop_correction.h"

namespace portolan {

// Two maps become one (paper Sec. 6, second step): the atlas_server proposes it from its replicas, the owner of both
// maps applies it.

/// map_from_other that an overlap says.
Sim3d MapFromOther(const Map& map, const Map& other, const LoopClosure& overlap);

/// Whether all keyframes of a camera, in both maps, had the same residual taken out. Fails with the keyframe that
/// differs: features of a place that the two lenses put apart are no place to weld. Maps of one mapper agree before
/// long.
Status CheckResiduals(const Map& map, const Map& other);

/// Proposes to take `other` into `map`. "The fusion method is similar to the correction method in the loop closing
/// thread, with the main difference being that all key frames and map points in the current map are corrected": on a
/// private copy all of `other` moves by the overlap's similarity (paper Eq. 13, 14); then the steps of CorrectLoop with
/// all of `map` held: duplicates around the overlap become one, a welding BA moves the keyframes of `other` there, a
/// pose graph lets the rest of `other` follow. Where the two maps run on side by side, the steps are repeated from
/// keyframe to keyframe.
/// @param overlap current: a keyframe of `other`; matched: one of `map`; current_from_matched: of their cameras, each
/// in its own map's units. Its `seen` and `merges` may name landmarks of both. Descriptors are needed of the keyframes
/// of `other` around the overlap (options.max_window of them): in others no duplicates are found.
/// @return the proposal, kind "fusion", of `map`: where `other` goes as a whole and, for its keyframes, in the units
/// that they have in `other`; all its points and those of `map` that the weld moved; merges and observations; as loop
/// edges the pairs (keyframe of other, of map) that hold the two together, the overlap's first. Or why there is none:
/// unknown keyframes, no similarity, elements that are in both maps, residuals that differ (CheckResiduals), too little
/// in common, "interrupted". `stop` (may be null) is looked at between and within the steps. `times` (may be null) gets
/// fusion_join, fusion_window, fusion_fusion, fusion_welding, fusion_graph. Deterministic.
Result<MapCorrection> ProposeFusion(const Map& map, const Map& other, const LoopClosure& overlap,
                                    const LoopCorrectionOptions& options, const std::atomic<bool>* stop,
                                    StageTimes* times);

/// Takes all of `other` into `map` by a proposal made from earlier states of both. Ids stay. Keyframes of `other` that
/// the proposal does not name follow their nearest ancestor in it, points the nearest keyframe that sees them, as in
/// ApplyMapCorrection. `other`'s spanning tree is hung, by the first loop edge whose two ends are still there, below
/// the keyframe of `map` that it names, and turned so that it begins there: one tree. Then the merges, then the
/// observations.
/// @return the merges made (from, into). Fails, changing nothing, for another kind, map, other or epoch, a revision to
/// come, values that are no similarity or not finite, an empty `other`, elements that are in both maps, residuals that
/// differ (CheckResiduals), or when none of its loop edges is left. What `other` knows of the residuals of cameras
/// `map` knows then, too.
Result<std::vector<std::pair<MapPointId, MapPointId>>> ApplyFusion(const MapCorrection& correction, const Map& other,
                                                                   Map* map);

}  // namespace portolan
