#pragma once

#include "dataset/plot_canvas.h"
#include "tool/map_list.h"

namespace portolan {

/// Draws a map graph: maps on a circle, as dots whose area goes with their keyframes, active ones in colour; lines
/// between maps as wide as their mutual activity is great, those without a link grey.
PlotCanvas DrawMapGraph(const DescribedGraph& described);

}  // namespace portolan
