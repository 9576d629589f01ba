#include "tracking/initializer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "features/feature_matcher.h"

namespace portolan {
namespace {

/// Where a far point at pixel_px of one view appears in the other, NaN behind it.
Eigen::Vector2d RotatePixel(const PinholeCamera& camera, const Eigen::Quaterniond& other_from_this,
                            const Eigen::Vector2d& pixel_px) {
  const Eigen::Vector3d ray = other_from_this * camera.Unproject(pixel_px);
  if (ray.z() <= 0) return Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
  return camera.Project(ray);
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

double RequiredBaseline(const InitializerOptions& options, const PinholeCamera& camera) {
  const double focal = std::max(camera.fx, camera.fy);
  const double half_view = std::hypot(camera.width, camera.height) / 2 / focal;
  return options.min_baseline_px *
         std::min({1.0, focal / options.reference_focal_px, half_view / options.reference_half_view});
}

void Initializer::SetFirst(const Frame& frame) {
  first_.reset();
  frames_since_first_ = 0;
  num_matches_ = 0;
  baseline_px_ = 0;
  current_from_first_ = Eigen::Quaterniond::Identity();
  if (static_cast<int>(frame.data->features.size()) < options_.min_features) return;
  first_ = frame;
  flow_px_.assign(frame.data->features.size(), Eigen::Vector2d::Zero());
}

std::vector<Eigen::Vector2d> Initializer::PredictPixels(const PinholeCamera& camera) const {
  std::vector<Eigen::Vector2d> predicted(flow_px_.size());
  for (size_t i = 0; i < predicted.size(); ++i) {
    predicted[i] =
        RotatePixel(camera, current_from_first_, first_->data->features.pixels_px[i].cast<double>()) + flow_px_[i];
  }
  return predicted;
}

std::optional<Initializer::Pair> Initializer::Offer(const Frame& frame, const Eigen::Quaterniond& current_from_last) {
  if (!first_) {
    SetFirst(frame);
    return std::nullopt;
  }
  current_from_first_ = (current_from_last * current_from_first_).normalized();
  const PinholeCamera& camera = frame.data->camera;
  const FeatureSet& first_features = first_->data->features;
  const FeatureSet& features = frame.data->features;

  MatcherOptions matcher;
  matcher.ratio = 0.9;  // windows are small and the two-view RANSAC comes after
  const std::vector<FeatureMatch> matches = MatchByWindow(first_features, PredictPixels(camera), features,
                                                          frame.data->grid, options_.search_radius_px, matcher);
  num_matches_ = matches.size();
  // "If there are insufficient correspondences the current frame is reset as the first key frame" (paper Sec. 4.1).
  if (static_cast<int>(matches.size()) < options_.min_matches || ++frames_since_first_ > options_.max_frames) {
    SetFirst(frame);
    return std::nullopt;
  }

  const Eigen::Quaterniond first_from_current = current_from_first_.conjugate();
  std::vector<double> motions_px;
  Pair pair;
  for (const FeatureMatch& match : matches) {
    const Eigen::Vector2d first_px = first_features.pixels_px[match.first].cast<double>();
    const Eigen::Vector2d second_px = features.pixels_px[match.second].cast<double>();
    flow_px_[match.first] = second_px - RotatePixel(camera, current_from_first_, first_px);
    motions_px.push_back((RotatePixel(camera, first_from_current, second_px) - first_px).norm());  // paper Eq. (8)
    pair.matches.emplace_back(match.first, match.second);
  }
  baseline_px_ = Median(std::move(motions_px));
  if (baseline_px_ < RequiredBaseline(options_, camera)) return std::nullopt;
  pair.first = *first_;
  pair.second = frame;
  pair.second_from_first = current_from_first_;
  pair.baseline_px = baseline_px_;
  return pair;
}

}  // namespace portolan
