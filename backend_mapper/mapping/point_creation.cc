#include "mapping/point_creation.h"

#include <cmath>

#include "geometry/triangulation.h"
#include "mapping/epipolar_search.h"

namespace portolan {

MatchTriangulator::MatchTriangulator(const KeyFrameView& first, const KeyFrameView& second,
                                     const PointCreationOptions& options)
    : first_(first), second_(second), options_(options) {
  const Rigid3d second_from_first = second.keyframe().camera_from_map * first.keyframe().camera_from_map.Inverse();
  fundamental_ = FundamentalFromMotion(second_from_first, first.camera(), second.camera());
}

bool MatchTriangulator::HasParallax(const Eigen::Vector2d& first_px, const Eigen::Vector2d& second_px) const {
  const Eigen::Vector3d first_ray = first_.rotation().transpose() * first_.camera().Unproject(first_px);
  const Eigen::Vector3d second_ray = second_.rotation().transpose() * second_.camera().Unproject(second_px);
  const double cosine = first_ray.dot(second_ray) / std::sqrt(first_ray.squaredNorm() * second_ray.squaredNorm());
  return cosine < options_.max_parallax_cos;
}

bool MatchTriangulator::Reprojects(const KeyFrameView& view, uint32_t feature,
                                   const Eigen::Vector3d& point_in_map) const {
  const Eigen::Vector3d in_camera = view.keyframe().camera_from_map * point_in_map;
  if (!(in_camera.z() > 0)) return false;
  const double squared_px = (view.camera().Project(in_camera) - view.Pixel(feature)).squaredNorm();
  return squared_px <= options_.reprojection_chi2 * view.Sigma(feature) * view.Sigma(feature);
}

bool MatchTriangulator::IsScaleConsistent(uint32_t first_feature, uint32_t second_feature,
                                          const Eigen::Vector3d& point_in_map) const {
  // A patch's true size is its size in pixels (its octave's scale) times distance over focal length: the same in both
  // views.
  const double first_distance = (point_in_map - first_.centre_in_map()).norm() / first_.camera().fx;
  const double second_distance = (point_in_map - second_.centre_in_map()).norm() / second_.camera().fx;
  const double ratio =
      (first_distance * first_.Sigma(first_feature)) / (second_distance * second_.Sigma(second_feature));
  return ratio < options_.max_scale_ratio && ratio * options_.max_scale_ratio > 1;
}

std::optional<Eigen::Vector3d> MatchTriangulator::Triangulate(uint32_t first_feature, uint32_t second_feature) const {
  const Eigen::Vector2d first_px = first_.Pixel(first_feature), second_px = second_.Pixel(second_feature);
  if (!HasParallax(first_px, second_px)) return std::nullopt;
  const auto [first_corrected, second_corrected] = CorrectMatch(fundamental_, first_px, second_px);  // paper Eq. (10)
  const auto point_in_map =
      TriangulateDlt(first_.keyframe().camera_from_map, second_.keyframe().camera_from_map,  // paper Eq. (11)
                     first_.camera().Normalize(first_corrected), second_.camera().Normalize(second_corrected));
  if (!point_in_map || !point_in_map->allFinite()) return std::nullopt;
  if (ParallaxCosine(first_.centre_in_map(), second_.centre_in_map(), *point_in_map) >= options_.max_parallax_cos)
    return std::nullopt;
  if (!Reprojects(first_, first_feature, *point_in_map) || !Reprojects(second_, second_feature, *point_in_map))
    return std::nullopt;
  if (!IsScaleConsistent(first_feature, second_feature, *point_in_map)) return std::nullopt;
  return point_in_map;
}

std::vector<MapPointId> CreatePoints(Map* map, KeyFrameId first, KeyFrameId second, const PointCreationOptions& options,
                                     IdMinter<MapPointId>* mint) {
  const KeyFrameView first_view(map->keyframe(first)), second_view(map->keyframe(second));
  const double baseline = (first_view.centre_in_map() - second_view.centre_in_map()).norm();
  const double first_depth = map->MedianDepth(first), second_depth = map->MedianDepth(second);
  std::vector<MapPointId> created;
  if (!(first_depth > 0) || !(second_depth > 0) || baseline < options.min_baseline * second_depth) return created;

  const MatchTriangulator triangulator(first_view, second_view, options);
  for (const FeatureMatch& match : SearchEpipolar(first_view, second_view, options.min_depth * first_depth, options)) {
    const auto point_in_map = triangulator.Triangulate(match.first, match.second);
    if (!point_in_map) continue;
    const MapPointId id = mint->Next();
    map->AddPoint(id, point_in_map->cast<float>());
    map->AddObservation(id, first, match.first);
    map->AddObservation(id, second, match.second);
    created.push_back(id);
  }
  return created;
}

}  // namespace portolan
