// A camera's residual, found after its first keyframes were made: how data and maps change with it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/random.h"
#include "features/feature_quantization.h"
#include "map/map.h"
#include "map/map_replica.h"

namespace portolan {
namespace {

constexpr RadialResidual kLens{0.05, -0.03};
constexpr double kStep = 1.0 / 32;  // of a location on the wire, pixels
const PinholeCamera kCamera{500, 500, 320, 240, 640, 480};

std::shared_ptr<const KeyFrameData> MakeData(uint32_t number, const PinholeCamera& camera = kCamera) {
  Random random(number);
  KeyFrameData data;
  data.id = KeyFrameId(0, 1, number);
  data.camera = camera;
  for (int i = 0; i < 200; ++i) {
    data.features.pixels_px.emplace_back(static_cast<float>(random.Uniform(0, 639)),
                                         static_cast<float>(random.Uniform(0, 479)));
    data.features.octaves.push_back(static_cast<uint8_t>(random.Below(8)));
    data.features.angles_rad.push_back(static_cast<float>(random.Uniform(0, 6)));
    data.features.descriptors.push_back(Descriptor{random.Next(), random.Next(), random.Next(), random.Next()});
  }
  QuantizeFeatures(&data.features, data.camera);
  auto made = *MakeKeyFrameData(std::move(data), nullptr);
  made.bow = {{7, 0.5f}};
  return std::make_shared<const KeyFrameData>(std::move(made));
}

TEST(KeyFrameResidual, IsTakenOutOfTheFeatures) {
  const auto data = MakeData(1);
  const auto changed = WithResidual(data, kLens);
  EXPECT_EQ(changed->residual, kLens);
  EXPECT_EQ(changed->bow, data->bow);
  EXPECT_EQ(changed->features.descriptors, data->features.descriptors);
  for (size_t i = 0; i < data->features.size(); ++i) {
    const Eigen::Vector2d xy = kLens.Distort(kCamera.Normalize(changed->features.pixels_px[i].cast<double>()));
    const Eigen::Vector2d back(kCamera.fx * xy.x() + kCamera.cx, kCamera.fy * xy.y() + kCamera.cy);
    const Eigen::Vector2d was = data->features.pixels_px[i].cast<double>();
    const Eigen::Vector2f now = changed->features.pixels_px[i];
    const bool is_at_the_edge = now.x() == 0 || now.y() == 0 || now.x() == 639 || now.y() == 479;
    EXPECT_TRUE(is_at_the_edge || (back - was).norm() < kStep)
        << was.transpose() << " came back as " << back.transpose();
  }
  FeatureSet rounded = changed->features;
  QuantizeFeatures(&rounded, kCamera);
  EXPECT_EQ(rounded.pixels_px, changed->features.pixels_px) << "a copy of it on the wire would differ";
}

TEST(KeyFrameResidual, IsNotTakenOutTwice) {
  const auto data = WithResidual(MakeData(1), kLens);
  EXPECT_EQ(WithResidual(data, kLens), data);
  const auto other = WithResidual(data, {0.02, 0});
  const auto at_once = WithResidual(MakeData(1), {0.02, 0});
  for (size_t i = 0; i < data->features.size(); ++i) {
    const Eigen::Vector2f inside = data->features.pixels_px[i] - Eigen::Vector2f(320, 240);
    if (std::abs(inside.x()) > 290 || std::abs(inside.y()) > 220) continue;  // the edge forgets
    EXPECT_LT((other->features.pixels_px[i] - at_once->features.pixels_px[i]).norm(), 2 * kStep);
  }
}

TEST(KeyFrameResidual, FeaturesAreFoundWhereTheyAreThen) {
  const auto changed = WithResidual(MakeData(1), kLens);
  for (uint32_t i = 0; i < changed->features.size(); ++i) {
    std::vector<uint32_t> found;
    changed->grid.Find(changed->features, changed->features.pixels_px[i].cast<double>(), 0.5, 0, 7, &found);
    EXPECT_THAT(found, testing::Contains(i));
  }
}

TEST(KeyFrameResidual, ChangesDataWithoutAppearanceAlike) {
  const auto data = MakeData(1);
  const auto bare = WithResidual(WithoutAppearance(*data), kLens);
  EXPECT_EQ(bare->features.pixels_px, WithResidual(data, kLens)->features.pixels_px);
  EXPECT_FALSE(bare->features.HasAppearance());
  EXPECT_EQ(WithoutAppearance(*bare)->residual, kLens);
}

class MapResidual : public testing::Test {
 protected:
  MapResidual() {
    owner_.AddKeyFrame(MakeData(1), Rigid3d(), KeyFrameId());
    owner_.AddKeyFrame(MakeData(2), Rigid3d(), KeyFrameId(0, 1, 1));
    owner_.AddKeyFrame(MakeData(3, other_camera_), Rigid3d(), KeyFrameId(0, 1, 1));
    for (uint32_t n : {1u, 2u}) replica_.AddKeyFrameData(MakeData(n));
    replica_.AddKeyFrameData(MakeData(3, other_camera_));
  }
  void Follow(MapDelta delta) {
    replica_.AddDelta(std::move(delta));
    ASSERT_EQ(replica_.ApplyPending().size(), 1u) << replica_.last_problem();
    ASSERT_EQ(HashMap(replica_.map()), HashMap(owner_));
    ASSERT_EQ(replica_.map().residuals(), owner_.residuals());
    for (const auto& [id, keyframe] : owner_.keyframes()) {
      const KeyFrameData& data = *replica_.map().keyframe(id).data;
      ASSERT_EQ(data.residual, keyframe.data->residual) << id;
      ASSERT_EQ(data.features.pixels_px, keyframe.data->features.pixels_px) << id;
      ASSERT_EQ(replica_.FindKeyFrameData(id), replica_.map().keyframe(id).data) << "kept twice";
    }
  }

  const PinholeCamera other_camera_{600, 600, 320, 240, 640, 480};
  Map owner_{MapId(0, 1, 1), 1};
  MapReplica replica_{MapId(0, 1, 1)};
};

TEST_F(MapResidual, ReachesReplicasWithTheNextDelta) {
  Follow(owner_.TakeDelta());
  owner_.SetResidual(kCamera, kLens);
  EXPECT_EQ(owner_.keyframe(KeyFrameId(0, 1, 2)).data->residual, kLens);
  EXPECT_TRUE(owner_.keyframe(KeyFrameId(0, 1, 3)).data->residual.IsNone()) << "it is another camera's";
  Follow(owner_.TakeDelta());
  EXPECT_EQ(replica_.map().keyframe(KeyFrameId(0, 1, 2)).data->residual, kLens);
}

TEST_F(MapResidual, ReachesThoseWhoComeLater) {
  owner_.SetResidual(kCamera, kLens);
  static_cast<void>(owner_.TakeDelta());
  Follow(owner_.Snapshot());
}

TEST_F(MapResidual, HoldsForKeyFramesToCome) {
  Follow(owner_.TakeDelta());
  owner_.SetResidual(kCamera, kLens);
  Follow(owner_.TakeDelta());
  owner_.AddKeyFrame(WithResidual(MakeData(4), kLens), Rigid3d(), KeyFrameId(0, 1, 1));  // the tracker knows already
  owner_.AddKeyFrame(MakeData(5), Rigid3d(), KeyFrameId(0, 1, 1));                       // it did not yet
  EXPECT_EQ(owner_.keyframe(KeyFrameId(0, 1, 5)).data->residual, kLens);
  replica_.AddKeyFrameData(WithResidual(MakeData(4), kLens));
  replica_.AddKeyFrameData(MakeData(5));
  Follow(owner_.TakeDelta());
}

TEST_F(MapResidual, IsReplacedByALaterOne) {
  owner_.SetResidual(kCamera, kLens);
  Follow(owner_.TakeDelta());
  owner_.SetResidual(kCamera, {0.01, 0});
  ASSERT_EQ(owner_.residuals().size(), 1u);
  EXPECT_EQ(owner_.keyframe(KeyFrameId(0, 1, 1)).data->residual, (RadialResidual{0.01, 0}));
  Follow(owner_.TakeDelta());
}

TEST_F(MapResidual, WhoMissedAnEarlierOneIsWithinStepsOfTheWire) {
  owner_.SetResidual(kCamera, kLens);
  owner_.SetResidual(kCamera, {0.01, 0});
  replica_.AddDelta(owner_.TakeDelta());
  ASSERT_EQ(replica_.ApplyPending().size(), 1u) << replica_.last_problem();
  const FeatureSet& ours = owner_.keyframe(KeyFrameId(0, 1, 1)).data->features;
  const FeatureSet& theirs = replica_.map().keyframe(KeyFrameId(0, 1, 1)).data->features;
  for (size_t i = 0; i < ours.size(); ++i) {
    const Eigen::Vector2f from_middle = ours.pixels_px[i] - Eigen::Vector2f(320, 240);
    if (std::abs(from_middle.x()) > 290 || std::abs(from_middle.y()) > 220) continue;  // the edge forgets
    EXPECT_LT((ours.pixels_px[i] - theirs.pixels_px[i]).norm(), 2 * kStep);
  }
}

TEST_F(MapResidual, OutOfRangeIsRefused) {
  Follow(owner_.TakeDelta());
  for (const double wrong : {2.0, -2.0, std::numeric_limits<double>::quiet_NaN()}) {
    MapDelta delta = owner_.Snapshot();
    delta.revision += 1;
    delta.residuals = {{kCamera, {0, wrong}}};
    Map copy = replica_.map();
    const Status applied =
        copy.Apply(delta, [](KeyFrameId id) { return MakeData(static_cast<uint32_t>(id.value & 0xffff)); });
    ASSERT_FALSE(applied.ok());
    EXPECT_THAT(applied.error().message, testing::HasSubstr("residual"));
  }
}

TEST_F(MapResidual, IsTakenOutOfStoredDataThatComesBack) {
  owner_.SetResidual(kCamera, kLens);
  Follow(owner_.TakeDelta());
  replica_.DropAppearance(KeyFrameId(0, 1, 1));
  replica_.RestoreAppearance(MakeData(1));  // as it was stored, before
  EXPECT_TRUE(replica_.map().keyframe(KeyFrameId(0, 1, 1)).data->features.HasAppearance());
  owner_.SetPose(KeyFrameId(0, 1, 1), Rigid3d(Eigen::Quaterniond::Identity(), {1, 0, 0}));
  Follow(owner_.TakeDelta());
}

/// A map that takes another's keyframes in, of whose data the replicas have what the other map made of it.
TEST_F(MapResidual, DataOfAnotherMapBecomesThisOnes) {
  owner_.SetResidual(kCamera, kLens);
  Follow(owner_.TakeDelta());
  MapReplica other(MapId(0, 1, 2));
  other.AddKeyFrameData(MakeData(4));
  owner_.AddKeyFrame(MakeData(4), Rigid3d(), KeyFrameId(0, 1, 1));
  replica_.AddDelta(owner_.TakeDelta());
  ASSERT_EQ(replica_.ApplyPending([&](KeyFrameId id) { return other.FindKeyFrameData(id); }).size(), 1u)
      << replica_.last_problem();
  const auto data = replica_.map().keyframe(KeyFrameId(0, 1, 4)).data;
  EXPECT_EQ(data->residual, kLens);
  EXPECT_EQ(data->features.pixels_px, owner_.keyframe(KeyFrameId(0, 1, 4)).data->features.pixels_px);
  EXPECT_EQ(replica_.FindKeyFrameData(KeyFrameId(0, 1, 4)), data);
  EXPECT_TRUE(other.FindKeyFrameData(KeyFrameId(0, 1, 4))->residual.IsNone());
}

TEST_F(MapResidual, SurvivesLosingItsAppearance) {
  Follow(owner_.TakeDelta());
  replica_.DropAppearance(KeyFrameId(0, 1, 1));
  owner_.SetResidual(kCamera, kLens);
  Follow(owner_.TakeDelta());
  EXPECT_FALSE(replica_.map().keyframe(KeyFrameId(0, 1, 1)).data->features.HasAppearance());
}

}  // namespace
}  // namespace portolan
