#include "mapping/local_bundle_adjustment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>

#include "mapping/mapping_test_scene.h"

namespace portolan {
namespace {

using ::testing::Contains;
using ::testing::IsEmpty;
using ::testing::Not;

class LocalBundle : public ::testing::Test {
 protected:
  void SetUp() override { Build({}, 6); }

  void Build(const TestSceneOptions& options, int count) {
    scene_ = std::make_unique<TestScene>(options);
    views_ = SeeAlongPath(scene_.get(), count, 0.4);
    map_ = BuildTrueMap(*scene_, views_);
  }
  KeyFrameId id(size_t view) const { return views_[view].data->id; }
  KeyFrameId last() const { return views_.back().data->id; }

  /// Moves points and all poses from the third on.
  void Perturb(double shift, uint64_t seed) {
    Random random(seed);
    const auto noise = [&]() -> Eigen::Vector3d {
      return {shift * random.Gaussian(), shift * random.Gaussian(), shift * random.Gaussian()};
    };
    for (const MapPointId point : map_.SortedPointIds()) {
      map_.SetPosition(point, map_.point(point).position_in_map + noise().cast<float>());
    }
    for (size_t k = 2; k < views_.size(); ++k) {
      const Rigid3d pose = views_[k].camera_from_map;
      map_.SetPose(id(k), Rigid3d(ExpSO3(0.1 * noise()) * pose.rotation, pose.translation + noise()));
    }
    map_.RefreshDerived();
  }
  double MedianPointError() const {
    std::vector<double> errors;
    for (const MapPointId point : map_.SortedPointIds()) {
      const auto truth = static_cast<size_t>(TruePointOf(map_.point(point), views_));
      errors.push_back((map_.point(point).position_in_map.cast<double>() - scene_->points_in_map()[truth]).norm());
    }
    std::nth_element(errors.begin(), errors.begin() + static_cast<ptrdiff_t>(errors.size() / 2), errors.end());
    return errors[errors.size() / 2];
  }
  double WorstCentreError() const {
    double worst = 0;
    for (const TestView& view : views_) {
      worst = std::max(worst, (map_.keyframe(view.data->id).camera_from_map.TargetOriginInSource() -
                               view.camera_from_map.TargetOriginInSource())
                                  .norm());
    }
    return worst;
  }

  LocalBundleOptions options_;
  std::unique_ptr<TestScene> scene_;
  std::vector<TestView> views_;
  Map map_;
};

TEST_F(LocalBundle, WindowOfASmallMapFixesItsTwoOldest) {
  const BundleWindow window = SelectLocalWindow(map_, last(), options_);
  EXPECT_THAT(window.fixed, ::testing::UnorderedElementsAre(id(0), id(1)));
  EXPECT_EQ(window.free.size(), 4u);
  EXPECT_EQ(window.free.front(), last());
}

TEST_F(LocalBundle, WindowIsBoundedAndHeldByOthers) {
  options_.max_keyframes = 3;
  options_.max_fixed = 2;
  const BundleWindow window = SelectLocalWindow(map_, last(), options_);
  EXPECT_EQ(window.free.size(), 3u);
  EXPECT_EQ(window.fixed.size(), 2u);
  for (const KeyFrameId fixed : window.fixed) EXPECT_THAT(window.free, Not(Contains(fixed)));
}

TEST_F(LocalBundle, TheFirstKeyFrameNeverMoves) {
  options_.max_keyframes = 3;
  const BundleWindow window = SelectLocalWindow(map_, id(0), options_);
  EXPECT_THAT(window.free, Not(Contains(id(0))));
  EXPECT_THAT(window.fixed, Contains(id(0)));
}

TEST_F(LocalBundle, RecoversAPerturbedMap) {
  Perturb(0.02, 3);
  options_.iterations = 10;
  const double before = MedianPointError();
  const LocalBundleResult result = OptimizeLocalWindow(&map_, last(), options_, nullptr);
  EXPECT_TRUE(result.summary.converged_or_stopped);
  EXPECT_LT(MedianPointError(), 0.05 * before);
  EXPECT_LT(WorstCentreError(), 1e-3);
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(LocalBundle, RemovesGrossErrors) {
  // Ten observations moved to another feature far away.
  const KeyFrame keyframe = map_.keyframe(id(3));
  std::vector<std::pair<MapPointId, uint32_t>> wrong;
  std::vector<uint32_t> features;
  for (uint32_t f = 0; f < keyframe.landmarks.num_features() && features.size() < 20; ++f) {
    const MapPointId landmark = keyframe.landmarks[f];
    if (landmark.IsValid() && map_.point(landmark).observations.size() >= 4) features.push_back(f);
  }
  ASSERT_EQ(features.size(), 20u);
  for (const uint32_t f : features) map_.RemoveObservation(keyframe.landmarks[f], id(3));
  for (size_t k = 0; k < 10; ++k) {
    ASSERT_TRUE(map_.AddObservation(keyframe.landmarks[features[k]], id(3), features[k + 10]));
    wrong.emplace_back(keyframe.landmarks[features[k]], features[k + 10]);
  }
  map_.RefreshDerived();
  const LocalBundleResult result = OptimizeLocalWindow(&map_, last(), options_, nullptr);
  EXPECT_GE(result.outliers, 9);  // one might lie near its right place by chance
  int left = 0;
  for (const auto& [landmark, feature] : wrong) {
    const MapPoint* point = map_.FindPoint(landmark);
    left += point != nullptr && point->FindObservation(id(3)) != nullptr ? 1 : 0;
  }
  EXPECT_LE(left, 1);
  EXPECT_LT(WorstCentreError(), 1e-2);
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(LocalBundle, ReducesNoiseAsItShould) {
  TestSceneOptions noisy;
  noisy.pixel_sigma = 0.33;  // as of corners that were matched rightly
  Build(noisy, 8);
  Perturb(0.05, 5);
  const double before = MedianPointError();
  OptimizeLocalWindow(&map_, last(), options_, nullptr);
  // At depth 7, 0.33 px * 2.5 (octave 5) / 500 is 0.012 across; depth from a base of 1.5 is three to five times worse.
  EXPECT_LT(MedianPointError(), std::min(0.05, before));
}

TEST_F(LocalBundle, InterruptedAtOnceLeavesAValidMapAndRemovesNothing) {
  Perturb(0.2, 3);  // 14 px at depth 7: most observations look like outliers until the solution settles
  const size_t points = map_.points().size();
  const std::atomic<bool> stop{true};
  const LocalBundleResult result = OptimizeLocalWindow(&map_, last(), options_, &stop);
  EXPECT_TRUE(result.summary.interrupted);
  EXPECT_EQ(result.outliers, 0);
  EXPECT_EQ(map_.points().size(), points);
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(LocalBundle, WhatDoesNotMoveIsNotPublished) {
  OptimizeLocalWindow(&map_, last(), options_, nullptr);
  map_.TakeDelta();
  OptimizeLocalWindow(&map_, last(), options_, nullptr);
  EXPECT_LT(map_.TakeDelta().points.size(), map_.points().size() / 50);
}

TEST_F(LocalBundle, LeavesAMapOfOneKeyFrameAlone) {
  Map map;
  map.AddKeyFrame(views_[0].data, Rigid3d(), KeyFrameId());
  map.TakeDelta();
  EXPECT_FALSE(OptimizeLocalWindow(&map, id(0), options_, nullptr).summary.converged_or_stopped);
  EXPECT_TRUE(map.TakeDelta().IsEmpty());
}

}  // namespace
}  // namespace portolan
