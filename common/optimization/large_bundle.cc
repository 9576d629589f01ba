#include "optimization/large_bundle.h"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "base/check.h"
#include "optimization/reprojection_cost.h"

namespace portolan {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Matrix63d = Eigen::Matrix<double, 6, 3>;

constexpr double kFirstDamping = 1e-6;  // of the diagonal: little, as what is left to correct bends the whole map
constexpr double kLeastDamping = 1e-9;
constexpr double kMostDamping = 1e3;
constexpr double kDampingFall = 0.2, kDampingRise = 10;
/// Longest step, in plain ones. Weights renewed each step bound the loss from above: its true curvature is smaller than
/// theirs, and with linear residuals no step up to twice as long raises the cost (Lange, MM Optimization Algorithms,
/// 2016). What bends a map as a whole is nearly flat for a loss as narrow as ours: on kitchen's local windows costs
/// fell by 1.9 to 2.0 times what the plain step promised, and five of those left the windows far from their optimum.
constexpr double kMostRelaxation = 2;
constexpr int kNotFree = -1;
/// Of so many measurements what elimination found is kept for the way back, some 200 bytes each; of more it is found
/// again.
constexpr size_t kMaxKeptMeasurements = 100000;

/// One measurement at the present state, weighted by the loss: error and Jacobians in sigmas.
struct Linearized {
  Eigen::Vector2d error;
  Eigen::Matrix<double, 2, 6> by_pose;  // of a rotation, then a translation, applied after camera_from_map
  Eigen::Matrix<double, 2, 3> by_point;
};

struct PoseState {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
};

/// What eliminating a point leaves.
struct Elimination {
  Eigen::Matrix3d inverse;                       // of its damped block
  Eigen::Vector3d gradient;                      // negative
  std::vector<std::pair<int, Matrix63d>> poses;  // free poses that see it, by number, and their mixed blocks
};

/// The reduced system: symmetric, of 6x6 blocks where two poses see a point in common, and its Cholesky factor, which
/// takes its place.
class ReducedSystem {
 public:
  /// @param partners of each free pose, those of higher number, in order.
  explicit ReducedSystem(const std::vector<std::vector<int>>& partners) {
    const size_t size = partners.size();
    FindOrder(partners);
    std::vector<std::vector<int>> children(size);
    columns_.resize(size);
    for (size_t j = 0; j < size; ++j) {
      for (const int i : partners[j]) {
        const int row = std::max(place_[j], place_[static_cast<size_t>(i)]),
                  column = std::min(place_[j], place_[static_cast<size_t>(i)]);
        columns_[static_cast<size_t>(column)].rows.push_back(row);
      }
    }
    size_t blocks = 0;
    for (size_t k = 0; k < size; ++k) {  // what elimination fills in passes on to the next pose that it couples
      std::vector<int>& rows = columns_[k].rows;
      for (const int child : children[k]) {
        const std::vector<int>& passed = columns_[static_cast<size_t>(child)].rows;
        rows.insert(rows.end(), passed.begin() + 1, passed.end());
      }
      std::sort(rows.begin(), rows.end());
      rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
      rows.shrink_to_fit();
      if (!rows.empty()) children[static_cast<size_t>(rows.front())].push_back(static_cast<int>(k));
      columns_[k].first = blocks;
      blocks += 1 + rows.size();
    }
    blocks_.resize(blocks);
    gradient.resize(static_cast<Eigen::Index>(6 * size));
    pose_diagonal.resize(static_cast<Eigen::Index>(6 * size));
  }

  void SetZero() {
    for (Matrix6d& block : blocks_) block.setZero();
    gradient.setZero();
    pose_diagonal.setZero();
  }

  /// Adds to the block in row i and column j, and to its mirror image.
  void Add(int i, int j, const Matrix6d& block) {
    const int row = place_[static_cast<size_t>(i)], column = place_[static_cast<size_t>(j)];
    if (row == column) {
      Diagonal(row) += block;
    } else if (row > column) {
      Below(column, row) += block;
    } else {
      Below(row, column) += block.transpose();
    }
  }

  /// By a share of what the poses' own blocks were before elimination.
  void Damp(double share) {
    constexpr double kTiny = 1e-12;  // for a pose that nothing holds
    for (size_t i = 0; i < place_.size(); ++i) {
      Diagonal(place_[i]).diagonal().array() +=
          share * pose_diagonal.segment<6>(static_cast<Eigen::Index>(6 * i)).array() + kTiny;
    }
  }

  /// @return false if the system is not positive definite; its blocks are of no use then.
  bool Factorize() {
    for (size_t k = 0; k < columns_.size(); ++k) {
      const std::vector<int>& rows = columns_[k].rows;
      Matrix6d* below = &blocks_[columns_[k].first] + 1;
      const Eigen::LLT<Matrix6d> factor(below[-1]);
      if (factor.info() != Eigen::Success) return false;
      const Matrix6d lower = factor.matrixL();
      below[-1] = lower;
      for (size_t s = 0; s < rows.size(); ++s) {
        below[s] = lower.triangularView<Eigen::Lower>().solve(below[s].transpose()).transpose().eval();
      }
      for (size_t s = 0; s < rows.size(); ++s) Update(rows, below, s);
    }
    return true;
  }

  /// The step that the factorised system gives for `gradient`.
  Eigen::VectorXd Solve() const {
    Eigen::VectorXd x(gradient.size());
    for (size_t i = 0; i < place_.size(); ++i)
      x.segment<6>(6 * place_[i]) = gradient.segment<6>(static_cast<Eigen::Index>(6 * i));
    for (size_t k = 0; k < columns_.size(); ++k) {
      auto own = x.segment<6>(static_cast<Eigen::Index>(6 * k));
      const Matrix6d* block = &blocks_[columns_[k].first];
      block->triangularView<Eigen::Lower>().solveInPlace(own);
      for (const int row : columns_[k].rows) x.segment<6>(6 * row).noalias() -= *++block * own;
    }
    for (size_t k = columns_.size(); k-- > 0;) {
      auto own = x.segment<6>(static_cast<Eigen::Index>(6 * k));
      const Matrix6d* diagonal = &blocks_[columns_[k].first];
      const Matrix6d* block = diagonal;
      for (const int row : columns_[k].rows) own.noalias() -= (++block)->transpose() * x.segment<6>(6 * row);
      diagonal->triangularView<Eigen::Lower>().transpose().solveInPlace(own);
    }
    Eigen::VectorXd step(gradient.size());
    for (size_t i = 0; i < place_.size(); ++i)
      step.segment<6>(static_cast<Eigen::Index>(6 * i)) = x.segment<6>(6 * place_[i]);
    return step;
  }

  Eigen::VectorXd gradient;       // negative, by pose
  Eigen::VectorXd pose_diagonal;  // of the poses' own blocks, by pose

 private:
  struct Column {
    std::vector<int> rows;  // below the diagonal, in order
    size_t first = 0;       // the diagonal's block; those of rows follow
  };

  /// The order of elimination that fills in little (approximate minimum degree).
  void FindOrder(const std::vector<std::vector<int>>& partners) {
    const auto size = static_cast<Eigen::Index>(partners.size());
    std::vector<Eigen::Triplet<double>> coupled;
    for (int j = 0; j < size; ++j) {
      coupled.emplace_back(j, j, 1.0);
      for (const int i : partners[static_cast<size_t>(j)]) {
        coupled.emplace_back(i, j, 1.0);
        coupled.emplace_back(j, i, 1.0);
      }
    }
    Eigen::SparseMatrix<double> pattern(size, size);
    pattern.setFromTriplets(coupled.begin(), coupled.end());
    Eigen::AMDOrdering<int>::PermutationType order;
    Eigen::AMDOrdering<int>()(pattern, order);
    place_.resize(partners.size());
    for (int k = 0; k < size; ++k) place_[static_cast<size_t>(order.indices()[k])] = k;
  }

  Matrix6d& Diagonal(int k) { return blocks_[columns_[static_cast<size_t>(k)].first]; }
  Matrix6d& Below(int column, int row) {
    const Column& of = columns_[static_cast<size_t>(column)];
    return blocks_[of.first + 1 +
                   static_cast<size_t>(std::lower_bound(of.rows.begin(), of.rows.end(), row) - of.rows.begin())];
  }

  /// Takes what block s of a finished column and those below it (at `below`) contribute out of column rows[s].
  void Update(const std::vector<int>& rows, const Matrix6d* below, size_t s) {
    const Column& target = columns_[static_cast<size_t>(rows[s])];
    Matrix6d* block = &blocks_[target.first];
    block->noalias() -= below[s] * below[s].transpose();
    size_t at = 0;
    for (size_t t = s + 1; t < rows.size(); ++t) {
      while (target.rows[at] != rows[t]) ++at;  // all of them are there: they were passed on
      block[1 + at].noalias() -= below[t] * below[s].transpose();
    }
  }

  std::vector<int> place_;       // of each pose in the order of elimination
  std::vector<Column> columns_;  // by place
  std::vector<Matrix6d> blocks_;
};

class LargeBundle {
 public:
  LargeBundle(const BundleProblem& problem, const BundleOptions& options) : problem_(problem), options_(options) {
    for (const BundleProblem::Pose& pose : problem.poses) {
      free_number_.push_back(pose.fixed ? kNotFree : num_free_);
      if (!pose.fixed) ++num_free_;
      poses_.push_back({pose.camera_from_map.rotation.toRotationMatrix(), pose.camera_from_map.translation});
    }
    points_ = problem.points_in_map;
    eliminated_.resize(problem.measurements.size() <= kMaxKeptMeasurements ? points_.size() : 1);
    SortMeasurements();
  }

  BundleSummary Solve(const std::atomic<bool>* stop) {
    BundleSummary summary;
    ReducedSystem system(FindPartners());
    double cost = Cost(poses_, points_);
    summary.initial_cost = summary.final_cost = cost;
    if (!std::isfinite(cost)) return summary;
    double damping = kFirstDamping, length = 1;
    while (summary.iterations < options_.max_iterations && damping < kMostDamping) {
      if (stop != nullptr && stop->load(std::memory_order_relaxed)) {
        summary.interrupted = true;
        break;
      }
      ++summary.iterations;
      std::vector<PoseState> poses = poses_;
      std::vector<Eigen::Vector3d> points = points_;
      double promised = 0;
      const bool stepped = Step(damping, length, &system, &poses, &points, &promised);
      const double stepped_cost = stepped ? Cost(poses, points) : std::numeric_limits<double>::infinity();
      if (!(stepped_cost < cost)) {
        damping *= kDampingRise;
        length = 1;
        continue;
      }
      length = LengthAfter(length, promised, cost - stepped_cost);
      poses_ = std::move(poses);
      points_ = std::move(points);
      damping = std::max(damping * kDampingFall, kLeastDamping);
      const double decrease = (cost - stepped_cost) / cost;
      cost = stepped_cost;
      if (decrease < options_.function_tolerance) break;
    }
    summary.final_cost = cost;
    summary.converged_or_stopped = true;
    return summary;
  }

  void WriteBack(BundleProblem* target) const {
    target->points_in_map = points_;
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (target->poses[i].fixed) continue;
      target->poses[i].camera_from_map =
          Rigid3d(Eigen::Quaterniond(poses_[i].rotation).normalized(), poses_[i].translation);
    }
  }

 private:
  /// By point: begins_ holds where each point's begin in order_.
  void SortMeasurements() {
    begins_.assign(points_.size() + 1, 0);
    for (const auto& m : problem_.measurements) ++begins_[m.point + 1];
    std::partial_sum(begins_.begin(), begins_.end(), begins_.begin());
    order_.resize(problem_.measurements.size());
    std::vector<uint32_t> next(begins_.begin(), begins_.end() - 1);
    for (size_t k = 0; k < problem_.measurements.size(); ++k)
      order_[next[problem_.measurements[k].point]++] = static_cast<uint32_t>(k);
  }

  std::vector<std::vector<int>> FindPartners() const {
    std::vector<std::vector<int>> partners(static_cast<size_t>(num_free_));
    std::vector<int> seen_by;
    for (size_t point = 0; point < points_.size(); ++point) {
      seen_by.clear();
      for (uint32_t k = begins_[point]; k < begins_[point + 1]; ++k) {
        const int number = free_number_[problem_.measurements[order_[k]].pose];
        if (number != kNotFree) seen_by.push_back(number);
      }
      for (const int a : seen_by) {
        for (const int b : seen_by) {
          if (a < b) partners[static_cast<size_t>(a)].push_back(b);
        }
      }
      if (point % kTidyInterval == kTidyInterval - 1) Tidy(&partners);
    }
    Tidy(&partners);
    return partners;
  }
  static void Tidy(std::vector<std::vector<int>>* partners) {
    for (std::vector<int>& of_one : *partners) {
      std::sort(of_one.begin(), of_one.end());
      of_one.erase(std::unique(of_one.begin(), of_one.end()), of_one.end());
    }
  }

  double Loss(double squared) const {
    if (!options_.robust) return 0.5 * squared;
    const double width = options_.loss_width * options_.loss_width;
    return 0.5 * width * std::log1p(squared / width);
  }

  double Cost(const std::vector<PoseState>& poses, const std::vector<Eigen::Vector3d>& points) const {
    double sum = 0;
    for (const auto& m : problem_.measurements) {
      const PoseState& pose = poses[m.pose];
      const Eigen::Vector3d q = pose.rotation * points[m.point] + pose.translation;
      const double squared =
          q.z() > 0 ? (problem_.poses[m.pose].camera.Project(q) - m.pixel_px).squaredNorm() / (m.sigma_px * m.sigma_px)
                    : 2 * kBehindCameraResidual * kBehindCameraResidual;
      sum += Loss(squared);
    }
    return sum;
  }

  /// @return false for a point behind the camera, which pulls at nothing.
  bool Linearize(const BundleProblem::Measurement& m, Linearized* out) const {
    const PoseState& pose = poses_[m.pose];
    const PinholeCamera& camera = problem_.poses[m.pose].camera;
    const Eigen::Vector3d q = pose.rotation * points_[m.point] + pose.translation;
    if (!(q.z() > 0)) return false;
    const double z = 1 / q.z();
    out->error = (camera.Project(q) - m.pixel_px) / m.sigma_px;
    const double width = options_.loss_width * options_.loss_width;
    const double weight = options_.robust ? 1 / std::sqrt(1 + out->error.squaredNorm() / width) : 1.0;
    const double scale = weight / m.sigma_px;
    out->error *= weight;
    Eigen::Matrix<double, 2, 3> by_q;
    by_q << scale * camera.fx * z, 0, -scale * camera.fx * q.x() * z * z, 0, scale * camera.fy * z,
        -scale * camera.fy * q.y() * z * z;
    Eigen::Matrix3d minus_cross;  // of q: a turn w moves it by w x q
    minus_cross << 0, q.z(), -q.y(), -q.z(), 0, q.x(), q.y(), -q.x(), 0;
    out->by_pose.leftCols<3>() = by_q * minus_cross;
    out->by_pose.rightCols<3>() = by_q;
    out->by_point = by_q * pose.rotation;
    return true;
  }

  /// @param system (may be null) gets what the point's measurements say of the poses, before elimination.
  void Eliminate(size_t point, double damping, ReducedSystem* system, Elimination* out) const {
    Eigen::Matrix3d block = Eigen::Matrix3d::Zero();
    out->gradient.setZero();
    out->poses.clear();
    Linearized one;
    for (uint32_t k = begins_[point]; k < begins_[point + 1]; ++k) {
      const auto& m = problem_.measurements[order_[k]];
      if (!Linearize(m, &one)) continue;
      block.noalias() += one.by_point.transpose() * one.by_point;
      out->gradient.noalias() -= one.by_point.transpose() * one.error;
      const int number = free_number_[m.pose];
      if (number == kNotFree) continue;
      out->poses.emplace_back(number, one.by_pose.transpose() * one.by_point);
      if (system == nullptr) continue;
      const Matrix6d own = one.by_pose.transpose() * one.by_pose;
      system->Add(number, number, own);
      system->pose_diagonal.segment<6>(6 * number) += own.diagonal();
      system->gradient.segment<6>(6 * number).noalias() -= one.by_pose.transpose() * one.error;
    }
    for (int i = 0; i < 3; ++i) block(i, i) += damping * block(i, i) + 1e-12;
    out->inverse = block.inverse();
  }

  /// The length at which the curvature along the last step would have put it at its lowest point. @param length of that
  /// step, in plain ones. @param promised decrease of the cost with a plain one, by the weights' curvature.
  static double LengthAfter(double length, double promised, double decrease) {
    if (!(promised > 0)) return 1;
    const double curvature = (2 * length - decrease / promised) / (length * length);  // of the weights': 1
    return curvature * kMostRelaxation < 1 ? kMostRelaxation : std::max(1.0, 1 / curvature);
  }

  /// Moves poses and points by one damped step from the present state. @param length in plain steps. @param promised
  /// gets the decrease of the cost that the linearised problem promises for a plain one.
  bool Step(double damping, double length, ReducedSystem* system, std::vector<PoseState>* poses,
            std::vector<Eigen::Vector3d>* points, double* promised) {
    const bool keeps = eliminated_.size() == points_.size();
    Eigen::VectorXd step = Eigen::VectorXd::Zero(6 * num_free_);
    system->SetZero();
    for (size_t point = 0; point < points_.size(); ++point) {
      Elimination* eliminated = &eliminated_[keeps ? point : 0];
      Eliminate(point, damping, system, eliminated);
      Reduce(*eliminated, system);
      *promised += 0.5 * eliminated->gradient.dot(eliminated->inverse * eliminated->gradient);
    }
    if (num_free_ > 0) {
      system->Damp(damping);
      if (!system->Factorize()) return false;
      step = system->Solve();
      if (!step.allFinite()) return false;
      *promised += 0.5 * system->gradient.dot(step);
      step *= length;
    }
    for (size_t point = 0; point < points_.size(); ++point) {
      Elimination* eliminated = &eliminated_[keeps ? point : 0];
      if (!keeps) Eliminate(point, damping, nullptr, eliminated);
      Eigen::Vector3d pull = length * eliminated->gradient;
      for (const auto& [number, mixed] : eliminated->poses)
        pull.noalias() -= mixed.transpose() * step.segment<6>(6 * number);
      (*points)[point] += eliminated->inverse * pull;
      if (!(*points)[point].allFinite()) return false;
    }
    for (size_t i = 0; i < poses->size(); ++i) {
      if (free_number_[i] == kNotFree) continue;
      const Eigen::Matrix3d turn = ExpSO3(step.segment<3>(6 * free_number_[i])).toRotationMatrix();
      (*poses)[i].rotation = turn * (*poses)[i].rotation;
      (*poses)[i].translation = turn * (*poses)[i].translation + step.segment<3>(6 * free_number_[i] + 3);
    }
    return true;
  }

  static void Reduce(const Elimination& eliminated, ReducedSystem* system) {
    for (const auto& [a, mixed_a] : eliminated.poses) {
      const Matrix63d scaled = mixed_a * eliminated.inverse;
      system->gradient.segment<6>(6 * a).noalias() -= scaled * eliminated.gradient;
      for (const auto& [b, mixed_b] : eliminated.poses) {
        if (b <= a) system->Add(a, b, -scaled * mixed_b.transpose());
      }
    }
  }

  static constexpr size_t kTidyInterval = 2048;  // points: bounds what FindPartners holds
  const BundleProblem& problem_;
  const BundleOptions options_;
  int num_free_ = 0;
  std::vector<int> free_number_;  // of each pose
  std::vector<PoseState> poses_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<uint32_t> begins_, order_;
  std::vector<Elimination> eliminated_;  // of each point, or of one at a time
};

}  // namespace

BundleSummary AdjustLargeBundle(BundleProblem* problem, const BundleOptions& options, const std::atomic<bool>* stop) {
  CheckBundle(*problem);
  if (!IsUsableBundle(*problem)) return {};
  LargeBundle bundle(*problem, options);
  const BundleSummary summary = bundle.Solve(stop);
  if (summary.converged_or_stopped) bundle.WriteBack(problem);
  return summary;
}

}  // namespace portolan
