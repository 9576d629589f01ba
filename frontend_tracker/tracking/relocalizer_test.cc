#include "tracking/relocalizer.h"

#include <gtest/gtest.h>

#include "tracking/synthetic_frame.h"
#include "vocabulary/vocabulary_training.h"

namespace portolan {
namespace {

constexpr size_t kLostView = 8;

/// Two places of different landmarks, with words of a vocabulary trained on descriptors of both. The second place is
/// the map.
class RelocalizerTest : public ::testing::Test {
 protected:
  RelocalizerTest() {
    SyntheticSceneOptions options;
    options.num_views = kLostView + 1;
    options.travel = 1.5;
    options.pixel_sigma_px = 0.5;
    options.descriptor_flip_ratio = 0.03;
    options.num_clutter = 100;
    scene_ = MakeSyntheticScene(options);
    options.seed = 99;
    elsewhere_ = MakeSyntheticScene(options);
    std::vector<std::vector<Descriptor>> images;
    for (const SyntheticScene* scene : {&scene_, &elsewhere_}) {
      for (const SyntheticView& view : scene->views) images.push_back(view.data->features.descriptors);
    }
    VocabularyTrainingOptions training;
    training.branching = 6;
    training.depth = 3;
    auto trained = TrainVocabulary(images, training, nullptr);
    vocabulary_ = trained.value();
    for (SyntheticView& view : scene_.views) view.data = MakeKeyFrameData(*view.data, vocabulary_.get());
    for (SyntheticView& view : elsewhere_.views) view.data = MakeKeyFrameData(*view.data, vocabulary_.get());
    MapBuilderOptions builder;
    builder.num_keyframes = kLostView;
    map_ = BuildMap(scene_, builder);
    static_cast<void>(map_.TakeDelta());
    for (const auto& [id, keyframe] : map_.keyframes()) index_.Add(id, WordsOf(keyframe.data));
  }

  SyntheticScene scene_, elsewhere_;
  std::shared_ptr<const Vocabulary> vocabulary_;
  Map map_;
  KeyFrameIndex index_;
  MapTracker tracker_{MapTrackingOptions()};
  Relocalizer relocalizer_{RelocalizerOptions(), 1};
};

TEST_F(RelocalizerTest, FindsThePlace) {
  Frame frame = FrameOfView(scene_, kLostView);
  ASSERT_TRUE(relocalizer_.Relocalize(map_, index_, std::nullopt, &tracker_, &frame));
  const Rigid3d truth = scene_.views[kLostView].camera_from_world;
  // As in tracking: half a pixel times the level's scale over f = 500, over the root of some hundred matches; a factor
  // 4 of safety.
  EXPECT_LT(frame.camera_from_map.rotation.angularDistance(truth.rotation), 1.5e-3);
  EXPECT_LT((frame.camera_from_map.TargetOriginInSource() - truth.TargetOriginInSource()).norm(), 1e-2);
  EXPECT_GT(frame.num_inliers, 100);
  EXPECT_LE(CountWrongLandmarks(scene_, kLostView, map_, frame.landmarks), 0.03 * frame.num_inliers);
}

TEST_F(RelocalizerTest, TracksAgainstAGivenKeyFrame) {
  Frame frame = FrameOfView(scene_, kLostView);
  ASSERT_TRUE(relocalizer_.TrackKeyFrame(map_, scene_.views[3].data->id, 30, &tracker_, &frame));
  EXPECT_LT(frame.camera_from_map.rotation.angularDistance(scene_.views[kLostView].camera_from_world.rotation), 1.5e-3);
  EXPECT_TRUE(Relocalizer::IsSure(frame));
  EXPECT_FALSE(relocalizer_.TrackKeyFrame(map_, scene_.views[3].data->id, 100000, &tracker_, &frame));
}

TEST_F(RelocalizerTest, AnotherPlaceIsNotFound) {
  for (size_t view = 0; view < elsewhere_.views.size(); view += 2) {
    Frame frame = FrameOfView(elsewhere_, view);
    EXPECT_FALSE(relocalizer_.Relocalize(map_, index_, std::nullopt, &tracker_, &frame));
  }
}

TEST_F(RelocalizerTest, ACornerThatLooksTheSameIsNoPlace) {
  // Of the place, the frame sees what is on a label in one corner; all else is of another place.
  Frame frame = FrameOfView(scene_, kLostView);
  Frame other = FrameOfView(elsewhere_, kLostView);
  FeatureSet features = other.data->features;
  const FeatureSet& label = frame.data->features;
  const PinholeCamera& camera = frame.data->camera;
  const auto append = [&](size_t i) {
    features.pixels_px.push_back(label.pixels_px[i]);
    features.octaves.push_back(label.octaves[i]);
    features.angles_rad.push_back(label.angles_rad[i]);
    features.descriptors.push_back(label.descriptors[i]);
  };
  size_t in_corner = 0;
  for (size_t i = 0; i < label.size(); ++i) {
    if (label.pixels_px[i].x() > 0.35f * static_cast<float>(camera.width) ||
        label.pixels_px[i].y() > 0.35f * static_cast<float>(camera.height))
      continue;
    append(i);
    ++in_corner;
  }
  ASSERT_GT(in_corner, 35u);
  KeyFrameData data = *other.data;
  data.features = features;
  other.data = MakeKeyFrameData(std::move(data), vocabulary_.get());
  other.landmarks.assign(features.size(), MapPointId());
  ASSERT_TRUE(relocalizer_.TrackKeyFrame(map_, scene_.views[3].data->id, 30, &tracker_, &other))
      << "by their number alone it would be believed";
  EXPECT_FALSE(Relocalizer::IsSure(other));
  EXPECT_FALSE(relocalizer_.Relocalize(map_, index_, std::nullopt, &tracker_, &other));
}

TEST_F(RelocalizerTest, APlaceOutOfReachOnlyLooksTheSame) {
  const Eigen::Vector3d centre = scene_.views[kLostView].camera_from_world.TargetOriginInSource();
  Frame frame = FrameOfView(scene_, kLostView);
  EXPECT_TRUE(relocalizer_.Relocalize(map_, index_, CameraReach{centre, 0.1}, &tracker_, &frame));
  EXPECT_FALSE(
      relocalizer_.Relocalize(map_, index_, CameraReach{centre + Eigen::Vector3d(0, 0, 0.2), 0.1}, &tracker_, &frame));
}

TEST_F(RelocalizerTest, NothingToFindInAnEmptyMapOrWithoutWords) {
  Frame frame = FrameOfView(scene_, kLostView);
  EXPECT_FALSE(relocalizer_.Relocalize(map_, KeyFrameIndex(), std::nullopt, &tracker_, &frame));
  EXPECT_FALSE(relocalizer_.TrackKeyFrame(map_, KeyFrameId(), 30, &tracker_, &frame));
  frame.data = MakeKeyFrameData(*frame.data, nullptr);
  EXPECT_FALSE(relocalizer_.Relocalize(map_, index_, std::nullopt, &tracker_, &frame));
}

}  // namespace
}  // namespace portolan
