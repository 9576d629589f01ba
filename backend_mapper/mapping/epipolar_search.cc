#include "mapping/epipolar_search.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "geometry/rigid3.h"

namespace portolan {
namespace {

/// The features of a keyframe that are no landmarks.
struct FreeFeatures {
  std::vector<uint32_t> index;
  std::vector<float> x, y;           // pixels
  std::vector<float> squared_limit;  // of the distance to the line, pixels^2

  FreeFeatures(const KeyFrameView& view, double chi2, const std::optional<Eigen::Vector2d>& epipole_px,
               double epipole_radius_px) {
    const FeatureSet& features = view.data().features;
    const std::vector<MapPointId> landmarks = view.keyframe().landmarks.ByFeature();
    for (uint32_t i = 0; i < features.size(); ++i) {
      if (landmarks[i].IsValid()) continue;
      if (epipole_px && (view.Pixel(i) - *epipole_px).norm() < epipole_radius_px * view.Sigma(i)) continue;
      index.push_back(i);
      x.push_back(features.pixels_px[i].x());
      y.push_back(features.pixels_px[i].y());
      squared_limit.push_back(static_cast<float>(chi2 * view.Sigma(i) * view.Sigma(i)));
    }
  }
};

/// Features in the order of their epipolar planes, those through both cameras' centres, by the plane's angle about the
/// baseline: what may lie on a line is at hand without a look at the others. Angles know no special case where the
/// epipole is far off or in the image.
class EpipolarPlanes {
 public:
  /// @param baseline direction of the first camera's centre in the second camera's frame.
  EpipolarPlanes(const FreeFeatures& features, const Eigen::Vector3d& baseline, const PinholeCamera& camera)
      : u_(baseline.unitOrthogonal()), v_(baseline.normalized().cross(u_)), begin_(kBins + 1) {
    // A line at distance d from a pixel has its plane at an angle D from the pixel's, with |sin D| <= d / (f r), where
    // r is the length of the pixel's ray (x, y, 1) across the baseline: as a line in pixels the plane's unit normal n
    // begins with n_x / fx and n_y / fy, which together are no longer than 1 / f.
    const double focal_px = std::min(camera.fx, camera.fy);
    std::vector<std::pair<int, int>> bins;  // of each feature the first and the last, which may be beyond kBins
    for (size_t k = 0; k < features.index.size(); ++k) {
      const Eigen::Vector3d ray = camera.Unproject(Eigen::Vector2d(features.x[k], features.y[k]));
      const double across = std::hypot(ray.dot(u_), ray.dot(v_));
      const double limit_px = std::sqrt(features.squared_limit[k]) + kRoundingPx;
      const double sine = limit_px / (focal_px * across);
      const double reach = sine < 1 ? std::asin(sine) / kBinAngle : kBins;
      const double place = Angle(ray) / kBinAngle;
      const int first = static_cast<int>(std::floor(place - reach));
      bins.emplace_back(first, std::min(static_cast<int>(std::floor(place + reach)), first + kBins - 1));
    }
    for (const auto& [first, last] : bins) {
      for (int bin = first; bin <= last; ++bin) ++begin_[Wrapped(bin) + 1];
    }
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    features_.resize(begin_.back());
    std::vector<uint32_t> next(begin_.begin(), begin_.end() - 1);
    for (size_t k = 0; k < bins.size(); ++k) {
      for (int bin = bins[k].first; bin <= bins[k].second; ++bin)
        features_[next[Wrapped(bin)]++] = static_cast<uint32_t>(k);
    }
  }

  /// All features within their limits of the line that a ray leaves, and some more: where they are in FreeFeatures,
  /// ascending. @return begin and end.
  std::pair<const uint32_t*, const uint32_t*> Near(const Eigen::Vector3d& ray) const {
    const size_t bin = Wrapped(static_cast<int>(Angle(ray) / kBinAngle));
    return {features_.data() + begin_[bin], features_.data() + begin_[bin + 1]};
  }

 private:
  // Over half a turn, as a plane goes both ways: 2 px at 700 px from the epipole, as wide as the limit at octave 0.
  static constexpr int kBins = 1024;
  static constexpr double kBinAngle = M_PI / kBins;
  // Of the distance to a line: single precision has steps of 1e-4 px at 1000 px, and of these there are a few.
  static constexpr double kRoundingPx = 0.01;

  /// From 0 to half a turn.
  double Angle(const Eigen::Vector3d& ray) const {
    const double angle = std::atan2(ray.dot(v_), ray.dot(u_));
    return angle < 0 ? angle + M_PI : angle;
  }
  static size_t Wrapped(int bin) { return static_cast<size_t>((bin % kBins + kBins) % kBins); }

  Eigen::Vector3d u_, v_;        // across the baseline
  std::vector<uint32_t> begin_;  // of each bin's features
  std::vector<uint32_t> features_;
};

/// The image of a ray between two depths: a x + b y + c = 0 with (a, b) of length 1, and the stretch of the line that
/// counts.
struct EpipolarSegment {
  float a, b, c;
  float begin, end;  // of the coordinate b x - a y along the line, which grows towards nearer points
};

/// The segment that a ray of the first camera leaves in the second, none if it lies behind the second camera from
/// infinity on.
/// @param ray the direction (x, y, 1) turned into the second camera's frame. @param origin the first camera's centre
/// there.
std::optional<EpipolarSegment> ImageOfRay(const Eigen::Vector3d& ray, const Eigen::Vector3d& origin, double min_depth,
                                          const PinholeCamera& camera) {
  if (!(ray.z() > 0)) return std::nullopt;
  const Eigen::Vector2d far_px = camera.Project(ray);
  // Derivative of the projection of ray + origin * inverse_depth at inverse depth 0: the direction in which points come
  // nearer.
  const Eigen::Vector2d towards(camera.fx * (origin.x() * ray.z() - ray.x() * origin.z()),
                                camera.fy * (origin.y() * ray.z() - ray.y() * origin.z()));
  const double length = towards.norm();
  if (!(length > 0)) return std::nullopt;
  const Eigen::Vector2d along = towards / length;
  const Eigen::Vector3d near_point = ray * min_depth + origin;
  EpipolarSegment segment{};
  segment.a = static_cast<float>(-along.y());
  segment.b = static_cast<float>(along.x());
  segment.c = static_cast<float>(along.y() * far_px.x() - along.x() * far_px.y());
  segment.begin = static_cast<float>(along.dot(far_px));
  segment.end = near_point.z() > 0 ? static_cast<float>(along.dot(camera.Project(near_point)))
                                   : std::numeric_limits<float>::max();
  return segment;
}

struct Best {
  uint32_t index = 0;
  int distance = 0;
};

/// The free feature nearest in descriptor among those on the segment; none if none is within max_distance.
/// @param near those to look at.
std::optional<Best> BestOnSegment(const EpipolarSegment& segment, const FreeFeatures& candidates,
                                  const std::pair<const uint32_t*, const uint32_t*>& near,
                                  const std::vector<Descriptor>& descriptors, const Descriptor& descriptor,
                                  int max_distance) {
  std::optional<Best> best;
  int best_distance = max_distance + 1;
  for (const uint32_t* next = near.first; next != near.second; ++next) {
    const uint32_t k = *next;
    const float x = candidates.x[k], y = candidates.y[k], squared_limit = candidates.squared_limit[k];
    const float off = segment.a * x + segment.b * y + segment.c;
    if (off * off > squared_limit) continue;
    const float along = segment.b * x - segment.a * y;
    const float slack = std::sqrt(squared_limit);
    if (along < segment.begin - slack || along > segment.end + slack) continue;
    const int distance = HammingDistance(descriptor, descriptors[candidates.index[k]]);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = Best{k, distance};
  }
  return best;
}

}  // namespace

std::vector<FeatureMatch> SearchEpipolar(const KeyFrameView& first, const KeyFrameView& second, double min_depth,
                                         const PointCreationOptions& options) {
  const Rigid3d second_from_first = second.keyframe().camera_from_map * first.keyframe().camera_from_map.Inverse();
  const Eigen::Matrix3d rotation = second_from_first.rotation.toRotationMatrix();
  const Eigen::Vector3d& origin = second_from_first.translation;
  std::optional<Eigen::Vector2d> epipole_px;
  if (origin.z() != 0) epipole_px = second.camera().Project(origin);

  const FreeFeatures candidates(second, options.epipolar_chi2, epipole_px, options.epipole_radius_px);
  const EpipolarPlanes planes(candidates, origin, second.camera());
  std::vector<FeatureMatch> best_of_candidate(candidates.index.size(), FeatureMatch{0, 0, options.max_distance + 1});
  const FeatureSet& features = first.data().features;
  const std::vector<MapPointId> landmarks = first.keyframe().landmarks.ByFeature();
  for (uint32_t i = 0; i < features.size(); ++i) {
    if (landmarks[i].IsValid()) continue;
    const Eigen::Vector3d ray = rotation * first.camera().Unproject(first.Pixel(i));
    const auto segment = ImageOfRay(ray, origin, min_depth, second.camera());
    if (!segment) continue;
    const auto best = BestOnSegment(*segment, candidates, planes.Near(ray), second.data().features.descriptors,
                                    features.descriptors[i], options.max_distance);
    if (!best || best->distance >= best_of_candidate[best->index].distance) continue;
    best_of_candidate[best->index] = FeatureMatch{i, candidates.index[best->index], best->distance};
  }
  std::vector<FeatureMatch> matches;
  for (const FeatureMatch& match : best_of_candidate) {
    if (match.distance <= options.max_distance) matches.push_back(match);
  }
  return KeepConsistentOrientation(features, second.data().features, matches);
}

}  // namespace portolan
