#include "optimization/pose_graph.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>

#include "base/check.h"
#include "optimization/pose_graph_cost.h"
#include "optimization/pose_graph_start.h"
#include "optimization/stop_callback.h"

namespace portolan {
namespace {

constexpr int kLogScale = 6;  // its place in a node's update
// From a start that is good the first steps should be whole Gauss-Newton steps: 2 to 3 iterations in place of 7 to 10.
constexpr double kFirstTrustRegion = 1e8;

/// Computes each free node's rotation once before the solver evaluates the edges.
class PrepareNodes final : public ceres::EvaluationCallback {
 public:
  explicit PrepareNodes(std::vector<SimilarityUpdate>* nodes) : nodes_(nodes) {}
  void PrepareForEvaluation(bool /*jacobians*/, bool is_new_point) override {
    if (!is_new_point) return;
    for (SimilarityUpdate& node : *nodes_) node.Prepare();
  }

 private:
  std::vector<SimilarityUpdate>* nodes_;
};

bool IsSound(const Sim3d& s) {
  return std::isfinite(s.scale) && s.scale > 0 && s.rotation.coeffs().allFinite() && s.rotation.norm() > 0 &&
         s.translation.allFinite();
}

bool IsUsable(const PoseGraph& graph) {
  const auto is_sound_node = [](const PoseGraph::Node& node) { return IsSound(node.camera_from_map); };
  const auto is_sound_edge = [](const PoseGraph::Edge& e) {
    return IsSound(e.j_from_i) && std::isfinite(e.weight) && std::isfinite(e.length) && e.length > 0;
  };
  return !graph.edges.empty() && std::all_of(graph.nodes.begin(), graph.nodes.end(), is_sound_node) &&
         std::all_of(graph.edges.begin(), graph.edges.end(), is_sound_edge);
}

double SquaredError(const PoseGraph& graph) {
  std::vector<SimilarityUpdate> nodes;
  for (const PoseGraph::Node& node : graph.nodes) nodes.emplace_back(node.camera_from_map);
  double sum = 0;
  for (const PoseGraph::Edge& edge : graph.edges) {
    Vector7d residual;
    EdgeCost(&nodes[edge.i], &nodes[edge.j], edge).Evaluate(nullptr, residual.data(), nullptr);
    sum += residual.squaredNorm();
  }
  return sum;
}

/// The graph itself, or one nearer to the solution.
PoseGraph BetterStart(const PoseGraph& graph, const PoseGraphOptions& options) {
  if (options.loss_width > 0) return graph;  // its start says which edges are right
  PoseGraph spread = SpreadErrors(graph, options.fix_scales);
  return IsUsable(spread) && SquaredError(spread) < SquaredError(graph) ? spread : graph;
}

void CheckContract(const PoseGraph& graph) {
  for (const PoseGraph::Edge& e : graph.edges) {
    PORTOLAN_CHECK(e.i < graph.nodes.size() && e.j < graph.nodes.size() && e.i != e.j)
        << "edge " << e.i << ", " << e.j << " of " << graph.nodes.size() << " nodes";
  }
}

/// The graph in Ceres' terms. It owns what the solver points to, none of which may move once the problem is built.
class CeresPoseGraph {
 public:
  CeresPoseGraph(const PoseGraph& source, const PoseGraphOptions& options)
      : prepare_(&nodes_), loss_(options.loss_width > 0 ? options.loss_width : 1.0), keep_scale_(7, {kLogScale}) {
    for (const PoseGraph::Node& node : source.nodes) nodes_.emplace_back(node.camera_from_map);
    ceres::Problem::Options problem_options;
    problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_options.disable_all_safety_checks = true;
    problem_options.evaluation_callback = &prepare_;
    problem_ = std::make_unique<ceres::Problem>(problem_options);
    for (const PoseGraph::Edge& edge : source.edges) {
      costs_.emplace_back(&nodes_[edge.i], &nodes_[edge.j], edge);
      problem_->AddResidualBlock(&costs_.back(), options.loss_width > 0 ? &loss_ : nullptr, nodes_[edge.i].parameters(),
                                 nodes_[edge.j].parameters());
    }
    for (size_t k = 0; k < nodes_.size(); ++k) {
      if (!problem_->HasParameterBlock(nodes_[k].parameters())) continue;
      if (options.fix_scales) problem_->SetManifold(nodes_[k].parameters(), &keep_scale_);
      if (source.nodes[k].fixed) problem_->SetParameterBlockConstant(nodes_[k].parameters());
    }
  }

  CeresPoseGraph(const CeresPoseGraph&) = delete;
  CeresPoseGraph& operator=(const CeresPoseGraph&) = delete;

  ceres::Solver::Summary Solve(const PoseGraphOptions& options, StopCallback* stop) {
    ceres::Solver::Options solver_options;
    solver_options.max_num_iterations = options.max_iterations;
    solver_options.function_tolerance = options.function_tolerance;
    solver_options.initial_trust_region_radius = kFirstTrustRegion;
    solver_options.num_threads = 1;
    solver_options.logging_type = ceres::SILENT;
    solver_options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver_options.callbacks.push_back(stop);
    ceres::Solver::Summary summary;
    ceres::Solve(solver_options, problem_.get(), &summary);
    return summary;
  }

  void WriteBack(PoseGraph* target) const {
    for (size_t k = 0; k < nodes_.size(); ++k) {
      if (!target->nodes[k].fixed) target->nodes[k].camera_from_map = nodes_[k].CameraFromMap();
    }
  }

 private:
  std::vector<SimilarityUpdate> nodes_;
  PrepareNodes prepare_;
  ceres::CauchyLoss loss_;
  ceres::SubsetManifold keep_scale_;
  std::deque<EdgeCost> costs_;
  std::unique_ptr<ceres::Problem> problem_;
};

}  // namespace

Vector7d EdgeResidual(const Sim3d& i_from_map, const Sim3d& j_from_map, const PoseGraph::Edge& edge) {
  const SimilarityUpdate i(i_from_map), j(j_from_map);
  Vector7d residual;
  EdgeCost(&i, &j, edge).Evaluate(nullptr, residual.data(), nullptr);
  return residual;
}

PoseGraphSummary OptimizePoseGraph(PoseGraph* graph, const PoseGraphOptions& options, const std::atomic<bool>* stop) {
  CheckContract(*graph);
  PoseGraphSummary result;
  if (!IsUsable(*graph)) return result;
  PoseGraph solved = BetterStart(*graph, options);
  CeresPoseGraph problem(solved, options);
  StopCallback stop_callback(stop);
  const ceres::Solver::Summary summary = problem.Solve(options, &stop_callback);
  result.interrupted = stop_callback.interrupted();
  result.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps;
  result.initial_cost = 0.5 * SquaredError(*graph);
  result.final_cost = summary.final_cost;
  if (!summary.IsSolutionUsable()) return result;

  problem.WriteBack(&solved);
  if (!IsUsable(solved)) return result;
  *graph = std::move(solved);
  result.converged_or_stopped = true;
  return result;
}

}  // namespace portolan
