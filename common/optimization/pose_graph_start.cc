#include "optimization/pose_graph_start.h"

#include <Eigen/SVD>
#include <Eigen/Sparse>
#include <cmath>

namespace portolan {
namespace {

/// Weight of a node's present value against its edges: far too small to be seen, but it holds what nothing else holds.
constexpr double kHold = 1e-8;

/// x_j = a x_i + b, for unknowns of size B x C (`a` is B x B).
template <int B, int C>
struct Relation {
  Eigen::Matrix<double, B, B> a;
  Eigen::Matrix<double, B, C> b;
  double weight;  ///< of its square
};

/// Weighted least squares over relations along the edges of a graph; fixed nodes are known.
template <int B, int C>
class RelationSolver {
 public:
  using Value = Eigen::Matrix<double, B, C>;

  /// @param values of the nodes: the known ones, and where those that nothing holds stay.
  RelationSolver(const PoseGraph& graph, std::vector<Value>* values) : graph_(graph), values_(values) {
    int next = 0;
    for (const PoseGraph::Node& node : graph.nodes) row_.push_back(node.fixed ? -1 : B * next++);
    right_.setZero(B * next, C);
    for (size_t k = 0; k < row_.size(); ++k) AddTo(row_[k], row_[k], kHold * Block::Identity(), kHold * (*values)[k]);
  }

  void Add(const PoseGraph::Edge& edge, const Relation<B, C>& relation) {
    const Block to_i = relation.weight * relation.a.transpose(), one = relation.weight * Block::Identity();
    const int i = row_[edge.i], j = row_[edge.j];
    AddTo(i, i, to_i * relation.a, -to_i * relation.b);
    AddTo(j, j, one, relation.weight * relation.b);
    if (i >= 0 && j >= 0) {
      AddTo(i, j, -to_i, Value::Zero());
      AddTo(j, i, -to_i.transpose(), Value::Zero());
    } else if (i >= 0) {
      right_.template middleRows<B>(i) += to_i * (*values_)[edge.j];
    } else if (j >= 0) {
      right_.template middleRows<B>(j) += relation.weight * relation.a * (*values_)[edge.i];
    }
  }

  /// @return false if the system can't be solved; the values are then as they were.
  bool Solve() {
    if (right_.rows() == 0) return true;
    Eigen::SparseMatrix<double> matrix(right_.rows(), right_.rows());
    matrix.setFromTriplets(left_.begin(), left_.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factors(matrix);
    if (factors.info() != Eigen::Success) return false;
    const Eigen::Matrix<double, Eigen::Dynamic, C> solution = factors.solve(right_);
    if (!solution.allFinite()) return false;
    for (size_t k = 0; k < row_.size(); ++k) {
      if (row_[k] >= 0) (*values_)[k] = solution.template middleRows<B>(row_[k]);
    }
    return true;
  }

 private:
  using Block = Eigen::Matrix<double, B, B>;

  void AddTo(int row, int column, const Block& block, const Value& right) {
    if (row < 0) return;
    for (int r = 0; r < B; ++r) {
      for (int c = 0; c < B; ++c) left_.emplace_back(row + r, column + c, block(r, c));
    }
    right_.template middleRows<B>(row) += right;
  }

  const PoseGraph& graph_;
  std::vector<Value>* values_;
  std::vector<int> row_;  // of a node's first unknown; -1: fixed
  std::vector<Eigen::Triplet<double>> left_;
  Eigen::Matrix<double, Eigen::Dynamic, C> right_;
};

using Scalar = Eigen::Matrix<double, 1, 1>;

bool SpreadScales(PoseGraph* graph) {
  std::vector<Scalar> logs;
  for (const PoseGraph::Node& node : graph->nodes) logs.emplace_back(std::log(node.camera_from_map.scale));
  RelationSolver<1, 1> solver(*graph, &logs);
  for (const PoseGraph::Edge& e : graph->edges) {
    solver.Add(e, {Scalar(1.0), Scalar(std::log(e.j_from_i.scale)), e.weight * e.weight});
  }
  if (!solver.Solve()) return false;
  for (size_t k = 0; k < logs.size(); ++k) {
    if (!graph->nodes[k].fixed) graph->nodes[k].camera_from_map.scale = std::exp(logs[k](0));
  }
  return true;
}

Eigen::Quaterniond NearestRotation(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU();
  if ((u * svd.matrixV().transpose()).determinant() < 0) u.col(2) *= -1;
  return Eigen::Quaterniond(Eigen::Matrix3d(u * svd.matrixV().transpose())).normalized();
}

bool SpreadRotations(PoseGraph* graph) {
  std::vector<Eigen::Matrix3d> rotations;
  for (const PoseGraph::Node& node : graph->nodes)
    rotations.push_back(node.camera_from_map.rotation.toRotationMatrix());
  RelationSolver<3, 3> solver(*graph, &rotations);
  for (const PoseGraph::Edge& e : graph->edges) {
    solver.Add(e, {e.j_from_i.rotation.toRotationMatrix(), Eigen::Matrix3d::Zero(), e.weight * e.weight});
  }
  if (!solver.Solve()) return false;
  for (size_t k = 0; k < rotations.size(); ++k) {
    if (!graph->nodes[k].fixed) graph->nodes[k].camera_from_map.rotation = NearestRotation(rotations[k]);
  }
  return true;
}

/// @param centres as they were before scales and rotations changed.
bool SpreadCentres(std::vector<Eigen::RowVector3d> centres, PoseGraph* graph) {
  RelationSolver<1, 3> solver(*graph, &centres);
  for (const PoseGraph::Edge& e : graph->edges) {
    const Sim3d& i = graph->nodes[e.i].camera_from_map;
    const double scale = e.j_from_i.scale * i.scale, weight = e.weight * scale / e.length;
    const Eigen::Vector3d step = -((e.j_from_i.rotation * i.rotation).conjugate() * e.j_from_i.translation) / scale;
    solver.Add(e, {Scalar(1.0), step.transpose(), weight * weight});
  }
  if (!solver.Solve()) return false;
  for (size_t k = 0; k < centres.size(); ++k) {
    Sim3d& s = graph->nodes[k].camera_from_map;
    if (!graph->nodes[k].fixed) s.translation = -s.scale * (s.rotation * centres[k].transpose());
  }
  return true;
}

}  // namespace

PoseGraph SpreadErrors(const PoseGraph& graph, bool keep_scales) {
  std::vector<Eigen::RowVector3d> centres;
  for (const PoseGraph::Node& node : graph.nodes) {
    centres.emplace_back(node.camera_from_map.Inverse().translation.transpose());
  }
  PoseGraph spread = graph;
  const bool solved =
      (keep_scales || SpreadScales(&spread)) && SpreadRotations(&spread) && SpreadCentres(std::move(centres), &spread);
  return solved ? spread : graph;
}

}  // namespace portolan
