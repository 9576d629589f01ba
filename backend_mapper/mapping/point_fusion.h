#pragma once

#include "base/ids.h"
#include "map/map.h"
#include "map_optimization/landmark_fusion.h"
#include "mapping/mapper_options.h"

namespace portolan {

/// The landmarks of a keyframe against its neighbours and their neighbours, both ways.
FusionResult FuseWithNeighbours(Map* map, KeyFrameId keyframe, const FusionOptions& options);

}  // namespace portolan
