#include "map/keyframe_landmarks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/check.h"
#include "base/random.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;

MapPointId Point(uint64_t sequence) {
  return MapPointId(0, 1, static_cast<uint32_t>(sequence));
}

TEST(KeyFrameLandmarks, AgreesWithAListByFeatureThroughChanges) {
  constexpr size_t kFeatures = 40;
  Random random(1);
  KeyFrameLandmarks landmarks(kFeatures);
  std::vector<MapPointId> expected(kFeatures);
  for (uint64_t step = 1; step <= 1000; ++step) {
    const size_t feature = random.Below(kFeatures);
    const MapPointId landmark = random.Below(2) == 0 ? MapPointId() : Point(step);
    landmarks.Set(feature, landmark);
    expected[feature] = landmark;
    ASSERT_EQ(landmarks.ByFeature(), expected);
  }
  std::vector<MapPointId> valid;
  for (size_t feature = 0; feature < kFeatures; ++feature) {
    EXPECT_EQ(landmarks[feature], expected[feature]);
    if (expected[feature].IsValid()) valid.push_back(expected[feature]);
  }
  EXPECT_EQ(std::vector<MapPointId>(landmarks.begin(), landmarks.end()), valid);
  EXPECT_FALSE(valid.empty());
}

TEST(KeyFrameLandmarks, ComeInTheOrderOfTheirFeatures) {
  KeyFrameLandmarks landmarks(10);
  landmarks.Set(7, Point(1));
  landmarks.Set(2, Point(3));
  landmarks.Set(9, Point(2));
  EXPECT_THAT(std::vector<MapPointId>(landmarks.begin(), landmarks.end()), ElementsAre(Point(3), Point(1), Point(2)));
  EXPECT_EQ(landmarks.num_features(), 10u);
}

TEST(KeyFrameLandmarks, FeaturesBeyondTheKeyFramesAreRefused) {
  KeyFrameLandmarks landmarks(10);
  EXPECT_THROW(landmarks.Set(10, Point(1)), CheckFailure);
  EXPECT_FALSE(landmarks[9].IsValid());
}

}  // namespace
}  // namespace portolan
