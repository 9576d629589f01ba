#include "mapping/epipolar_search.h"

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <optional>

#include "geometry/rigid3.h"

namespace portolan {
namespace {

/// The features of a keyframe that are no landmarks, as arrays for a vectorised distance to a line.
struct FreeFeatures {
  std::vector<uint32_t> index;
  Eigen::ArrayXf x, y;           // pixels
  Eigen::ArrayXf squared_limit;  // of the distance to the line, pixels^2

  FreeFeatures(const KeyFrameView& view, double chi2, const std::optional<Eigen::Vector2d>& epipole_px,
               double epipole_radius_px) {
    const FeatureSet& features = view.data().features;
    const std::vector<MapPointId> landmarks = view.keyframe().landmarks.ByFeature();
    index.reserve(features.size());
    for (uint32_t i = 0; i < features.size(); ++i) {
      if (landmarks[i].IsValid()) continue;
      if (epipole_px && (view.Pixel(i) - *epipole_px).norm() < epipole_radius_px * view.Sigma(i)) continue;
      index.push_back(i);
    }
    const auto count = static_cast<Eigen::Index>(index.size());
    x.resize(count);
    y.resize(count);
    squared_limit.resize(count);
    for (Eigen::Index k = 0; k < count; ++k) {
      const uint32_t i = index[static_cast<size_t>(k)];
      x[k] = features.pixels_px[i].x();
      y[k] = features.pixels_px[i].y();
      squared_limit[k] = static_cast<float>(chi2 * view.Sigma(i) * view.Sigma(i));
    }
  }
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
std::optional<Best> BestOnSegment(const EpipolarSegment& segment, const FreeFeatures& candidates,
                                  const std::vector<Descriptor>& descriptors, const Descriptor& descriptor,
                                  int max_distance, Eigen::ArrayXf* excess) {
  *excess = (segment.a * candidates.x + segment.b * candidates.y + segment.c).square() - candidates.squared_limit;
  std::optional<Best> best;
  int best_distance = max_distance + 1;
  const float* values = excess->data();
  for (size_t k = 0; k < candidates.index.size(); ++k) {
    if (values[k] > 0) continue;
    const auto e = static_cast<Eigen::Index>(k);
    const float along = segment.b * candidates.x[e] - segment.a * candidates.y[e];
    const float slack = std::sqrt(candidates.squared_limit[e]);
    if (along < segment.begin - slack || along > segment.end + slack) continue;
    const int distance = HammingDistance(descriptor, descriptors[candidates.index[k]]);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = Best{static_cast<uint32_t>(k), distance};
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
  std::vector<FeatureMatch> best_of_candidate(candidates.index.size(), FeatureMatch{0, 0, options.max_distance + 1});
  Eigen::ArrayXf excess;
  const FeatureSet& features = first.data().features;
  const std::vector<MapPointId> landmarks = first.keyframe().landmarks.ByFeature();
  for (uint32_t i = 0; i < features.size(); ++i) {
    if (landmarks[i].IsValid()) continue;
    const auto segment =
        ImageOfRay(rotation * first.camera().Unproject(first.Pixel(i)), origin, min_depth, second.camera());
    if (!segment) continue;
    const auto best = BestOnSegment(*segment, candidates, second.data().features.descriptors, features.descriptors[i],
                                    options.max_distance, &excess);
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
