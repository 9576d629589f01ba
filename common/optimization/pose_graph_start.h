#pragma once

#include "optimization/pose_graph.h"

namespace portolan {

/// A start for OptimizePoseGraph that has the drift of closed loops spread already, whatever it was: the parts of the
/// residual are minimised one after the other, each of which is linear when the ones before are known:
///   1. scales:    log s_j = log s_M + log s_i
///   2. rotations: R_j = R_M R_i, as free matrices, then the nearest rotations (chordal relaxation)
///   3. centres:   c_j = c_i - (R_M R_i)^T t_M / (s_M s_i)
/// Source of 2: Carlone et al., Initialization techniques for 3D SLAM, ICRA 2015. From a graph that has all its error
/// at the seam, Levenberg-Marquardt takes 10 to 50 iterations, and for large turns ends elsewhere; from here 2 to 5.
/// @param keep_scales leaves out step 1. Fixed nodes stay. Parts of the graph without a fixed node stay near where they
/// are.
PoseGraph SpreadErrors(const PoseGraph& graph, bool keep_scales);

}  // namespace portolan
