#pragma once

#include <optional>
#include <string>
#include <vector>

#include "dataset/loop_closures.h"
#include "dataset/plot_canvas.h"
#include "dataset/trajectory_evaluation.h"

namespace portolan {

struct TrajectoryPlotOptions {
  std::string title;
  bool per_map = false;                              ///< each map by its own alignment; else all by the joined one
  std::optional<std::vector<LoopClosure>> closures;  ///< marked, each with a line between its two places
};

/// Draws the ground truth and the aligned estimate in the plane of the ground truth's two axes of largest extent, at
/// one scale, each map in a colour of its own, with a legend that tells the ATE. Lines break where tracking had a gap.
/// A closure is drawn if the estimate has poses at both of its times; the legend counts all of them.
PlotCanvas DrawTrajectories(const Evaluation& evaluation, const TrajectoryPlotOptions& options);

}  // namespace portolan
