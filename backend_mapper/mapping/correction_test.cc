#include "mapping/correction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "mapping/mapping_test_scene.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

class Correction : public ::testing::Test {
 protected:
  void SetUp() override {
    scene_ = std::make_unique<TestScene>();
    views_ = SeeAlongPath(scene_.get(), 6, 0.4);
    map_ = BuildTrueMap(*scene_, views_);
    map_.TakeDelta();
    correction_.number = 3;
    correction_.map = map_.id();
    correction_.epoch = map_.epoch();
    correction_.made_from_revision = map_.revision();
    correction_.kind = "loop";
  }
  /// Asks for the keyframe to be where the similarity takes it.
  void AddCorrected(size_t view, const Sim3d& new_from_old) {
    const Sim3d old(map_.keyframe(views_[view].data->id).camera_from_map);
    correction_.keyframes.push_back({views_[view].data->id, old * new_from_old.Inverse()});
  }
  std::unique_ptr<TestScene> scene_;
  std::vector<TestView> views_;
  Map map_;
  MapCorrection correction_;
};

TEST_F(Correction, ASimilarityOfAllKeepsEveryReprojection) {
  const Map before = map_;
  const Sim3d new_from_old(1.7, ExpSO3({0.1, -0.3, 0.2}), {1, 2, 3});
  for (size_t k = 0; k < views_.size(); ++k) AddCorrected(k, new_from_old);
  ASSERT_TRUE(ApplyMapCorrection(correction_, &map_).ok());
  for (const auto& [id, point] : map_.points()) {
    const Eigen::Vector3d moved = new_from_old * before.point(id).position_in_map.cast<double>();
    EXPECT_LT((point.position_in_map.cast<double>() - moved).norm(), 1e-5);
    for (const Observation& o : point.observations) {
      const KeyFrame& keyframe = map_.keyframe(o.keyframe);
      const Eigen::Vector2d pixel =
          keyframe.data->camera.Project(keyframe.camera_from_map * point.position_in_map.cast<double>());
      EXPECT_LT((pixel - keyframe.data->features.pixels_px[o.feature].cast<double>()).norm(), 1e-2);
    }
  }
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(Correction, YoungerKeyFramesAndPointsFollow) {
  const Map before = map_;
  const Sim3d new_from_old(0.5, ExpSO3({0, 0.2, 0}), {0, 1, 0});
  for (size_t k = 0; k < 4; ++k) AddCorrected(k, new_from_old);  // 4 and 5 came after the snapshot
  ASSERT_TRUE(ApplyMapCorrection(correction_, &map_).ok());
  for (size_t k = 0; k < views_.size(); ++k) {
    const KeyFrameId id = views_[k].data->id;
    const Rigid3d expected = TransformPose(before.keyframe(id).camera_from_map, new_from_old);
    const Rigid3d difference = map_.keyframe(id).camera_from_map * expected.Inverse();
    EXPECT_LT(LogSE3(difference).norm(), 1e-9) << "view " << k;
  }
}

TEST_F(Correction, TakesPointsAndMerges) {
  AddCorrected(0, Sim3d());
  const auto ids = map_.SortedPointIds();
  correction_.points.push_back({ids[0], Eigen::Vector3f(1, 2, 3)});
  correction_.points.push_back({MapPointId(8, 8, 8), Eigen::Vector3f(1, 2, 3)});
  correction_.merges = {{ids[1], ids[2]}, {MapPointId(8, 8, 8), ids[2]}, {ids[1], ids[3]}};
  const auto merged = ApplyMapCorrection(correction_, &map_);
  ASSERT_TRUE(merged.ok());
  EXPECT_THAT(*merged, ::testing::ElementsAre(std::make_pair(ids[1], ids[2])));
  EXPECT_EQ(map_.point(ids[0]).position_in_map, Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(map_.FindPoint(ids[1]), nullptr);
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(Correction, RefusesWhatDoesNotFit) {
  AddCorrected(0, Sim3d());
  const auto refuses = [&](const std::function<void(MapCorrection*)>& spoil, const std::string& because) {
    MapCorrection spoilt = correction_;
    spoil(&spoilt);
    const uint64_t before = HashMap(map_);
    const auto result = ApplyMapCorrection(spoilt, &map_);
    ASSERT_FALSE(result.ok()) << because;
    EXPECT_THAT(result.error().message, HasSubstr(because));
    EXPECT_EQ(HashMap(map_), before);
  };
  refuses([](MapCorrection* c) { c->map = MapId(4, 4, 4); }, "the map here");
  refuses([](MapCorrection* c) { c->epoch = 77; }, "epoch 77");
  refuses([](MapCorrection* c) { c->made_from_revision = 999; }, "revision 999");
  refuses([](MapCorrection* c) { c->keyframes[0].camera_from_map.scale = 0; }, "not a similarity");
  refuses(
      [](MapCorrection* c) {
        c->keyframes[0].camera_from_map.translation.x() = std::numeric_limits<double>::quiet_NaN();
      },
      "not a similarity");
  refuses(
      [](MapCorrection* c) {
        c->points.push_back({MapPointId(1, 1, 1), Eigen::Vector3f::Constant(1.0f / 0.0f)});
      },
      "not finite");
  refuses([](MapCorrection* c) { c->keyframes[0].id = KeyFrameId(4, 4, 4); }, "none of its");
}

}  // namespace
}  // namespace portolan
