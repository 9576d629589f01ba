#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <unordered_set>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "base/statistics.h"
#include "geometry/sim3.h"
#include "map/map.h"
#include "map/protocol.h"
#include "map_optimization/essential_graph.h"
#include "map_optimization/landmark_fusion.h"

namespace portolan {

/// A verified loop: the current keyframe sees what the matched one saw.
struct LoopClosure {
  KeyFrameId current, matched;
  /// Of their cameras, each in its own units: the current one is drifted, the matched one not.
  Sim3d current_from_matched;
  std::vector<std::pair<uint32_t, MapPointId>>
      seen;  ///< (feature of the current keyframe, landmark of the matched side)
  std::vector<std::pair<MapPointId, MapPointId>>
      merges;  ///< (landmark of the current side, landmark of the matched side)
  std::vector<std::pair<KeyFrameId, KeyFrameId>> earlier_edges;  ///< loop edges of earlier corrections
};

struct LoopCorrectionOptions {
  int max_window = 30;        ///< keyframes around the current one that are corrected and welded, itself included
  int max_matched_side = 30;  ///< keyframes around the matched one that they are welded to, itself included
  int min_common = 15;        ///< landmarks that a keyframe shares with the one in the middle
  /// A verified similarity is some pixels off at the far end of the window: 4 sigma.
  LandmarkFusionOptions search{16.0, 50, true};
  int bundle_iterations = 10;     ///< of the welding BA
  double bundle_chi2 = 5.991;     ///< squared normalised error of an outlier after it
  int min_welded_landmarks = 20;  ///< that both sides see after it: fewer, and the loop is refused
  int min_loop_common = 30;  ///< landmarks that make a loop edge between a welded keyframe and one of the matched side
  EssentialGraphOptions graph;
};

/// Closes a loop (paper Sec. 5, third step) on a private copy of the map:
///   1. window:     the current keyframe and its neighbours move by the drift, S_i = S_ic S_c (paper Eq. 13), with what
///   they
///                  see (paper Eq. 14)
///   2. fusion:     landmarks of the matched side are looked for in the window's keyframes; duplicates become one
///   3. welding BA: the window against the matched side, which is fixed; refuses a loop that leaves too little in
///   common
///   4. pose graph: over the whole map, with the welded window, the loop edges, and all else as it was before
/// @return the proposal, kind "loop": all keyframes as similarities, welded points, merges and observations of the
/// fusion, loop edges; or why there is none: unknown keyframes, no similarity, a weld that fails, or "interrupted".
/// `stop` (may be null) is looked at between and within the steps. `times` (may be null) gets loop_window, loop_fusion,
/// loop_welding, loop_graph. Deterministic.
Result<MapCorrection> CorrectLoop(const Map& map, const LoopClosure& loop, const LoopCorrectionOptions& options,
                                  const std::atomic<bool>* stop, StageTimes* times);

/// What moves when a gap is closed, and what the proposal is.
struct CorrectionFrame {
  std::string kind = "loop";            ///< of the proposal, its stage times and reasons
  std::unordered_set<KeyFrameId> held;  ///< keyframes of the map that stay where they are; none: its first one alone
};

/// The same where some keyframes are held, the matched one among them (map fusion: all of the older map): they are not
/// in the proposal.
Result<MapCorrection> CorrectLoop(const Map& map, const LoopClosure& loop, const CorrectionFrame& frame,
                                  const LoopCorrectionOptions& options, const std::atomic<bool>* stop,
                                  StageTimes* times);

}  // namespace portolan
