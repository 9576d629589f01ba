#pragma once

#include "map/map.h"

namespace portolan {

/// How badly a map agrees with what its keyframes saw: the loss that BA minimises (Cauchy's, width
/// kReprojectionLossWidth), mean over all observations. A proposal after which it is larger is no improvement.
/// @return 0 for a map without observations.
double MeanReprojectionLoss(const Map& map);

}  // namespace portolan
