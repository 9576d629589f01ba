#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <vector>

#include "geometry/sim3.h"

namespace portolan {

using Vector7d = Eigen::Matrix<double, 7, 1>;

/// Cameras as similarities, and what is known of pairs of them. A similarity camera_from_map of scale s has lengths in
/// the camera's own units: s of them are one map unit. Indices refer to the vectors here.
struct PoseGraph {
  struct Node {
    Sim3d camera_from_map;
    bool fixed = false;
  };
  struct Edge {
    uint32_t i = 0, j = 0;
    Sim3d j_from_i;       ///< measured
    double weight = 1.0;  ///< of the residual
    double length = 1.0;  ///< in j's units: an error of this much translation counts like one radian. The scene's depth
  };
  std::vector<Node> nodes;
  std::vector<Edge> edges;
};

struct PoseGraphOptions {
  int max_iterations = 50;  ///< of Levenberg-Marquardt; graphs of closed loops need 2 to 10
  bool fix_scales = false;  ///< every node keeps the scale that it has
  /// Of Cauchy's loss, in units of the residual; 0: least squares. It lets go of a wrong edge, and just as well of a
  /// right one that the start contradicts: not for a loop that is being closed. (Huber's would not do: a wrong edge
  /// pulls at the end of a long lever.)
  double loss_width = 0;
  double function_tolerance = 1e-5;  ///< relative decrease of the cost at which it is done
};

struct PoseGraphSummary {
  bool converged_or_stopped = false;  ///< false: nothing usable came out and the graph is unchanged
  bool interrupted = false;           ///< stopped by `stop`; the graph holds the best state so far
  int iterations = 0;
  double initial_cost = 0;  ///< half sum of squares of the graph as given, without the loss
  double final_cost = 0;    ///< of the result, under the loss
};

/// How far an edge is from the nodes, with E = j_from_i * S_i * S_j^-1 the identity of a graph that agrees:
///   [t_E / length, Log(R_E), log(s_E)] * weight
/// To first order this is the logarithm of Sim(3) at E, the usual choice (Strasdat, Local
/// accuracy and global consistency for efficient visual SLAM, 2012, Sec. 5); unlike it, it is linear in the cameras'
/// centres whatever the error, has closed derivatives without series, and its parts keep their units.
Vector7d EdgeResidual(const Sim3d& i_from_map, const Sim3d& j_from_map, const PoseGraph::Edge& edge);

/// Optimises the free nodes in place (paper Sec. 5, third step), with Ceres: Levenberg-Marquardt, sparse normal
/// Cholesky, analytic derivatives, from the start that SpreadErrors finds (pose_graph_start.h) if it is better than the
/// given one. Unknowns of a node: its centre in the map, its rotation, the logarithm of its scale. At least one node of
/// each connected part must be fixed, else that part floats (harmless, but its frame is arbitrary). `stop` may be null;
/// once true the solver returns after the current iteration. A graph with a value that is not finite, a scale or length
/// that is not positive, or no edge, is refused. Deterministic.
PoseGraphSummary OptimizePoseGraph(PoseGraph* graph, const PoseGraphOptions& options, const std::atomic<bool>* stop);

}  // namespace portolan
