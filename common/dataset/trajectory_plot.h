#pragma once

#include <string>

#include "base/result.h"
#include "dataset/plot_canvas.h"
#include "dataset/trajectory_evaluation.h"

namespace portolan {

struct TrajectoryPlotOptions {
  std::string title;
  bool per_map = false;  ///< each map by its own alignment; else all by the joined one
};

/// Draws the ground truth and the aligned estimate in the plane of the ground truth's two axes of largest extent, at
/// one scale, each map in a colour of its own, with a legend that tells the ATE. Lines break where tracking had a gap.
PlotCanvas DrawTrajectories(const Evaluation& evaluation, const TrajectoryPlotOptions& options);

}  // namespace portolan
