#include "mapping/epipolar_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <tuple>
#include <vector>

#include "geometry/rigid3.h"
#include "mapping/mapping_test_scene.h"

namespace portolan {
namespace {

using ::testing::UnorderedElementsAreArray;

using Triple = std::tuple<uint32_t, uint32_t, int>;  // two features and the distance of their descriptors

class EpipolarSearchTest : public ::testing::Test {
 protected:
  /// Two views of a scene, every second point of which is a landmark already.
  void MakeScene(const Eigen::Vector3d& second_centre, const Eigen::Vector3d& turn = {0.01, 0.05, 0.02}) {
    TestSceneOptions options;
    options.clutter = 300;
    options.pixel_sigma = 0.5;
    options.flipped_bits = 20;
    TestScene scene(options);
    const std::vector<TestView> views = {scene.See(CameraAt({0, 0, 0})), scene.See(CameraAt(second_centre, turn))};
    map_ = std::make_unique<Map>(BuildTrueMap(scene, views, 2));
    first_.emplace(map_->keyframe(views[0].data->id));
    second_.emplace(map_->keyframe(views[1].data->id));
  }

  /// As SearchEpipolar's documentation has it, with a look at every pair.
  std::vector<FeatureMatch> SearchAll(double min_depth) const {
    const Rigid3d second_from_first =
        second_->keyframe().camera_from_map * first_->keyframe().camera_from_map.Inverse();
    const Eigen::Vector2d epipole_px = second_->camera().Project(second_from_first.translation);
    std::map<uint32_t, FeatureMatch> of_second;
    for (uint32_t i = 0; i < first_->data().features.size(); ++i) {
      if (!first_->IsFree(i)) continue;
      const Eigen::Vector3d ray = second_from_first.rotation * first_->camera().Unproject(first_->Pixel(i));
      const Eigen::Vector3d nearest = ray * min_depth + second_from_first.translation;
      if (ray.z() <= 0) continue;
      const Eigen::Vector2d far_px = second_->camera().Project(ray);
      // Where the ray is at 1000 times the nearest depth: towards there its points come nearer.
      const Eigen::Vector3d on_ray = 1000 * min_depth * ray + second_from_first.translation;
      const Eigen::Vector2d along = (second_->camera().Project(on_ray) - far_px).normalized();
      std::optional<FeatureMatch> best;
      for (uint32_t j = 0; j < second_->data().features.size(); ++j) {
        const double sigma_px = second_->Sigma(j);
        if (!second_->IsFree(j) || (second_->Pixel(j) - epipole_px).norm() < options_.epipole_radius_px * sigma_px)
          continue;
        const Eigen::Vector2d from_far = second_->Pixel(j) - far_px;
        const double limit_px = std::sqrt(options_.epipolar_chi2) * sigma_px;
        const double off_px = std::abs(from_far.x() * along.y() - from_far.y() * along.x());
        if (off_px > limit_px || from_far.dot(along) < -limit_px) continue;
        if (nearest.z() > 0 &&
            from_far.dot(along) > (second_->camera().Project(nearest) - far_px).dot(along) + limit_px)
          continue;
        const int distance =
            HammingDistance(first_->data().features.descriptors[i], second_->data().features.descriptors[j]);
        if (distance <= options_.max_distance && (!best || distance < best->distance))
          best = FeatureMatch{i, j, distance};
      }
      if (!best) continue;
      const auto [known, is_new] = of_second.emplace(best->second, *best);
      if (!is_new && best->distance < known->second.distance) known->second = *best;
    }
    std::vector<FeatureMatch> matches;
    for (const auto& [feature, match] : of_second) matches.push_back(match);
    return KeepConsistentOrientation(first_->data().features, second_->data().features, matches);
  }

  static std::vector<Triple> Triples(const std::vector<FeatureMatch>& matches) {
    std::vector<Triple> triples;
    for (const FeatureMatch& match : matches) triples.emplace_back(match.first, match.second, match.distance);
    return triples;
  }

  PointCreationOptions options_;
  std::unique_ptr<Map> map_;
  std::optional<KeyFrameView> first_, second_;
};

TEST_F(EpipolarSearchTest, IsOneToOneAndSparesLandmarks) {
  MakeScene({0.8, 0.1, 0});
  std::set<uint32_t> firsts, seconds;
  for (const FeatureMatch& match : SearchEpipolar(*first_, *second_, 1.0, options_)) {
    EXPECT_TRUE(firsts.insert(match.first).second);
    EXPECT_TRUE(seconds.insert(match.second).second);
    EXPECT_TRUE(first_->IsFree(match.first) && second_->IsFree(match.second));
    EXPECT_LE(match.distance, options_.max_distance);
  }
  EXPECT_GT(firsts.size(), 50u);
}

/// The order by epipolar planes leaves none out, wherever the epipole is: far off on any side, in the image, at its rim
/// or behind.
TEST_F(EpipolarSearchTest, FindsWhatALookAtEveryPairFinds) {
  const Eigen::Vector3d ways[] = {{0.8, 0.1, 0},   {-0.8, 0, 0},     {0, 0.7, 0},     {0, -0.7, 0.1},   {0.6, 0.6, 0},
                                  {0.05, 0.02, 1}, {0.02, 0.03, -1}, {0.5, 0.2, 0.8}, {-0.4, 0.4, 0.6}, {0, 0, 1}};
  for (const Eigen::Vector3d& way : ways) {
    for (const Eigen::Vector3d& turn : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0.02, -0.15, 0.4)}) {
      SCOPED_TRACE(::testing::Message() << "to " << way.transpose() << ", turned by " << turn.transpose());
      MakeScene(way, turn);
      for (const double min_depth : {0.1, 1.0}) {
        const auto expected = Triples(SearchAll(min_depth));
        EXPECT_GT(expected.size(), 20u);
        EXPECT_THAT(Triples(SearchEpipolar(*first_, *second_, min_depth, options_)),
                    UnorderedElementsAreArray(expected));
      }
    }
  }
}

}  // namespace
}  // namespace portolan
