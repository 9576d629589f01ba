#include "testing/synthetic_sequence.h"

#include <gtest/gtest.h>

#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

namespace portolan {
namespace {

SequenceOptions Small(const std::string& scene) {
  SequenceOptions options;
  options.scene = scene;
  options.width = 320;
  options.height = 240;
  options.texture_px = 256;
  return options;
}

SyntheticSequence MakeOrThrow(const SequenceOptions& options) {
  return SyntheticSequence::Make(options).value();
}

class SceneTest : public testing::TestWithParam<const char*> {};

TEST_P(SceneTest, MovesSmoothlyWithRisingStamps) {
  const SyntheticSequence sequence = MakeOrThrow(Small(GetParam()));
  const std::vector<SyntheticFrame>& frames = sequence.frames();
  ASSERT_GT(frames.size(), 300u);
  for (size_t i = 1; i < frames.size(); ++i) {
    EXPECT_NEAR(SecondsBetween(frames[i - 1].stamp, frames[i].stamp), 0.05, 1e-8);
    if (frames[i].black || frames[i - 1].black) continue;
    const Rigid3d step = frames[i].world_from_camera.Inverse() * frames[i - 1].world_from_camera;
    EXPECT_LT(step.translation.norm(), 0.26) << i;       // 5 m/s at most
    EXPECT_LT(LogSO3(step.rotation).norm(), 0.05) << i;  // 57 degrees a second
    if (i < 2 || frames[i - 2].black) continue;
    const Rigid3d before = frames[i - 1].world_from_camera.Inverse() * frames[i - 2].world_from_camera;
    EXPECT_LT((LogSO3(step.rotation) - LogSO3(before.rotation)).norm(), 0.012) << i;
    EXPECT_LT((step.translation - before.translation).norm(), 0.012) << i;
  }
}

TEST_P(SceneTest, HasFeaturesAllOverTypicalFrames) {
  SequenceOptions options = Small(GetParam());
  options.width = 640;
  options.height = 480;
  options.texture_px = 512;
  const SyntheticSequence sequence = MakeOrThrow(options);
  SequenceRenderer renderer(sequence);
  const cv::Ptr<cv::ORB> orb = cv::ORB::create(2000);
  for (const double share : {0.05, 0.5, 0.95}) {
    const cv::Mat picture = renderer.Render(static_cast<size_t>(share * static_cast<double>(sequence.frames().size())));
    std::vector<cv::KeyPoint> keypoints;
    orb->detect(picture, keypoints);
    EXPECT_GT(keypoints.size(), 1000u) << share;
    int quadrants[4] = {};
    for (const cv::KeyPoint& keypoint : keypoints)
      ++quadrants[(keypoint.pt.x > 320 ? 1 : 0) + (keypoint.pt.y > 240 ? 2 : 0)];
    for (const int count : quadrants) EXPECT_GT(count, 40) << share;
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, SceneTest, testing::Values("town", "street", "room", "wall", "rotation", "blackout"));

TEST(SyntheticSequence, SameSeedSameBytesInAnyOrder) {
  SequenceOptions options = Small("room");
  options.sensor.exposure_change = 0.2;
  options.sensor.exposure_s = 0.01;
  const SyntheticSequence a = MakeOrThrow(options), b = MakeOrThrow(options);
  SequenceRenderer renderer_a(a), renderer_b(b);
  const cv::Mat late = renderer_a.Render(30), early = renderer_a.Render(3);
  EXPECT_EQ(cv::norm(early, renderer_b.Render(3), cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(late, renderer_b.Render(30), cv::NORM_INF), 0);
  options.seed = 2;
  const SyntheticSequence c = MakeOrThrow(options);
  EXPECT_GT(cv::norm(early, SequenceRenderer(c).Render(3), cv::NORM_L1) / early.total(), 10);
}

TEST(SyntheticSequence, NoiseHasItsSigmaAndIsNewInEachFrame) {
  SequenceOptions options = Small("rotation");
  options.sensor.noise_sigma = 0;
  const SyntheticSequence clean = MakeOrThrow(options);
  options.sensor.noise_sigma = 3;
  const SyntheticSequence noisy = MakeOrThrow(options);
  const auto noise = [&](size_t frame) {
    cv::Mat difference, clean_picture;
    SequenceRenderer(noisy).Render(frame).convertTo(difference, CV_32F);
    SequenceRenderer(clean).Render(frame).convertTo(clean_picture, CV_32F);
    difference -= clean_picture;
    return difference;
  };
  const cv::Mat first = noise(0), second = noise(1);
  cv::Scalar mean, deviation;
  cv::meanStdDev(first, mean, deviation);
  EXPECT_NEAR(mean[0], 0, 0.1);                             // 3 / sqrt(76800) = 0.011, and the table's own mean
  EXPECT_NEAR(deviation[0], std::sqrt(9 + 2.0 / 12), 0.1);  // two roundings
  EXPECT_LT(std::abs(first.dot(second)) / first.dot(first), 0.05);
}

TEST(SyntheticSequence, ALensBendsThePicturesAndNothingElse) {
  SequenceOptions options = Small("room");
  options.sensor.noise_sigma = 0;
  const SyntheticSequence plain = MakeOrThrow(options);
  options.lens = {-0.15, 0.02};
  const SyntheticSequence bent = MakeOrThrow(options);
  EXPECT_EQ(bent.camera(), plain.camera());
  EXPECT_EQ(bent.frames()[5].world_from_camera.translation, plain.frames()[5].world_from_camera.translation);
  const cv::Mat through_lens = SequenceRenderer(bent).Render(5);
  // What the lens shows comes back where it belongs when it is undone.
  cv::Mat to_bent_px(options.height, options.width, CV_32FC2), undone;
  const PinholeCamera& camera = plain.camera();
  for (int y = 0; y < options.height; ++y) {
    for (int x = 0; x < options.width; ++x) {
      const Eigen::Vector2d bent_px =
          camera.Project(options.lens.Distort(camera.Normalize(Eigen::Vector2d(x, y))).homogeneous());
      to_bent_px.at<cv::Vec2f>(y, x) = {static_cast<float>(bent_px.x()), static_cast<float>(bent_px.y())};
    }
  }
  cv::remap(through_lens, undone, to_bent_px, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  const cv::Mat ideal = SequenceRenderer(plain).Render(5);
  const double per_pixel = 1.0 / static_cast<double>(ideal.total());
  EXPECT_LT(cv::norm(undone, ideal, cv::NORM_L1) * per_pixel,
            0.3 * cv::norm(through_lens, ideal, cv::NORM_L1) * per_pixel);
}

TEST(SyntheticSequence, MotionBlurSmoothsMovingPictures) {
  SequenceOptions options = Small("wall");
  options.sensor.noise_sigma = 0;
  const SyntheticSequence sharp = MakeOrThrow(options);
  options.sensor.exposure_s = 0.05;
  options.speed = 3;
  const SyntheticSequence blurred = MakeOrThrow(options);
  const auto sharpness = [](const cv::Mat& picture) {
    cv::Mat edges;
    cv::Sobel(picture, edges, CV_32F, 1, 0);
    return cv::norm(edges, cv::NORM_L1);
  };
  // The same place on the path, a quarter of the way, where the camera is fastest.
  EXPECT_LT(sharpness(SequenceRenderer(blurred).Render(40)), 0.8 * sharpness(SequenceRenderer(sharp).Render(120)));
}

TEST(SyntheticSequence, RotationHasAStretchWithoutAnyTranslation) {
  const SyntheticSequence sequence = MakeOrThrow(Small("rotation"));
  double longest = 0, turned = 0;
  size_t start = 0;
  for (size_t i = 1; i < sequence.frames().size(); ++i) {
    const Rigid3d& first = sequence.frames()[start].world_from_camera;
    const Rigid3d& pose = sequence.frames()[i].world_from_camera;
    if ((pose.translation - first.translation).norm() > 1e-9) {
      start = i;
      turned = 0;
      continue;
    }
    turned = std::max(turned, pose.rotation.angularDistance(first.rotation));
    if (turned > 0.5)
      longest = std::max(longest, SecondsBetween(sequence.frames()[start].stamp, sequence.frames()[i].stamp));
  }
  EXPECT_GT(longest, 8);
}

TEST(SyntheticSequence, BlackoutGoesOnElsewhereAndComesBack) {
  const SyntheticSequence sequence = MakeOrThrow(Small("blackout"));
  const std::vector<SyntheticFrame>& frames = sequence.frames();
  size_t first = 0, last = 0;
  for (size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].black && first == 0) first = i;
    if (frames[i].black) last = i;
  }
  ASSERT_GT(first, 100u);
  EXPECT_EQ(last - first + 1, 16u);
  SequenceRenderer renderer(sequence);
  EXPECT_LT(cv::mean(renderer.Render(first))[0], 3);
  EXPECT_GT(cv::mean(renderer.Render(last + 1))[0], 30);
  const auto turn = [&](size_t a, size_t b) {
    return frames[a].world_from_camera.rotation.angularDistance(frames[b].world_from_camera.rotation);
  };
  for (size_t i = 0; i < first; i += 10)
    EXPECT_GT(turn(last + 1, i), 1.0);  // another direction, more than a field of view (62 degrees) away
  size_t revisits = 0;
  for (size_t i = last + 1; i < frames.size(); ++i) {
    for (size_t j = 0; j < first; j += 10) {
      if (turn(i, j) < 0.25 &&
          (frames[i].world_from_camera.translation - frames[j].world_from_camera.translation).norm() < 0.4) {
        ++revisits;
        break;
      }
    }
  }
  EXPECT_GT(revisits, 200u);
}

TEST(SyntheticSequence, TownClosesItsLoop) {
  const SyntheticSequence sequence = MakeOrThrow(Small("town"));
  const std::vector<SyntheticFrame>& frames = sequence.frames();
  size_t revisits = 0;
  for (size_t i = frames.size() / 2; i < frames.size(); ++i) {
    for (size_t j = 0; j < frames.size() / 4; ++j) {
      const Rigid3d step = frames[i].world_from_camera.Inverse() * frames[j].world_from_camera;
      if (step.translation.norm() < 1 && LogSO3(step.rotation).norm() < 0.3) {
        ++revisits;
        break;
      }
    }
  }
  EXPECT_GT(revisits, 100u);
}

TEST(SyntheticSequence, RepeatedFacadesComeFromASmallPool) {
  SequenceOptions options = Small("town");
  options.texture_px = 64;
  const size_t unlike = MakeOrThrow(options).world().textures.size();
  options.repeat_facades = true;
  EXPECT_LT(MakeOrThrow(options).world().textures.size() + 40, unlike);
}

TEST(SyntheticSequence, SpeedShortensTheWayAndFramesCutIt) {
  SequenceOptions options = Small("wall");
  const size_t whole = MakeOrThrow(options).frames().size();
  options.speed = 2;
  EXPECT_NEAR(static_cast<double>(MakeOrThrow(options).frames().size()), whole / 2.0, 1);
  options.num_frames = 7;
  EXPECT_EQ(MakeOrThrow(options).frames().size(), 7u);
}

TEST(SyntheticSequence, BadOptionsAreNamed) {
  const auto message = [](const SequenceOptions& options) {
    const Result<SyntheticSequence> sequence = SyntheticSequence::Make(options);
    return sequence.ok() ? std::string() : sequence.error().message;
  };
  SequenceOptions options = Small("village");
  EXPECT_NE(message(options).find("'village', expected one of town"), std::string::npos) << message(options);
  options = Small("wall");
  options.width = 10;
  EXPECT_NE(message(options).find("size: 10x240"), std::string::npos) << message(options);
  options = Small("wall");
  options.fps = std::nan("");
  EXPECT_NE(message(options).find("fps"), std::string::npos);
  options = Small("wall");
  options.texture_px = 300;
  EXPECT_NE(message(options).find("power of two"), std::string::npos);
  options = Small("wall");
  options.lens = {-1, 0};
  EXPECT_NE(message(options).find("lens: -1"), std::string::npos);
  options = Small("wall");
  options.sensor.noise_sigma = -1;
  EXPECT_NE(message(options).find("noise_sigma"), std::string::npos);
}

}  // namespace
}  // namespace portolan
