#pragma once

#include <atomic>
#include <optional>

#include "base/result.h"
#include "base/statistics.h"
#include "map/map.h"
#include "map/protocol.h"
#include "map_optimization/keyframe_adjustment.h"

namespace portolan {

/// Global BA (paper Sec. 5): all keyframes of a snapshot and their landmarks. The
/// map keeps its frame and scale.
/// @return the proposal, kind "global_ba"; or why there is none: too small a map, no improvement, "interrupted".
/// `stop` (may be null) ends it after the current iteration, without a result. `times` (may be null) gets global_ba;
/// `losses` (may be null): see CompleteCorrection. Deterministic.
Result<MapCorrection> AdjustGlobally(const Map& map, const KeyFrameAdjustmentOptions& options,
                                     const std::atomic<bool>* stop, StageTimes* times,
                                     std::optional<LossChange>* losses = nullptr);

}  // namespace portolan
