#include "features/feature_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "base/check.h"
#include "base/random.h"

namespace portolan {
namespace {

constexpr int kWidth = 333, kHeight = 201;  // no multiples of a cell

FeatureSet RandomFeatures(size_t count, uint64_t seed) {
  Random random(seed);
  FeatureSet features;
  for (size_t i = 0; i < count; ++i) {
    features.pixels_px.emplace_back(static_cast<float>(random.Uniform(0, kWidth - 1)),
                                    static_cast<float>(random.Uniform(0, kHeight - 1)));
    features.octaves.push_back(static_cast<uint8_t>(random.Below(8)));
    features.angles_rad.push_back(0);
    features.descriptors.push_back({});
  }
  return features;
}

TEST(FeatureGrid, FindsWhatASearchOfAllFinds) {
  const FeatureSet features = RandomFeatures(500, 1);
  const FeatureGrid grid(features, kWidth, kHeight);
  Random random(2);
  for (int trial = 0; trial < 300; ++trial) {
    const Eigen::Vector2d centre_px(random.Uniform(-50, kWidth + 50), random.Uniform(-50, kHeight + 50));
    const double radius_px = random.Uniform(0, 60);
    const int min_octave = static_cast<int>(random.Below(8)), max_octave = static_cast<int>(random.Below(8));
    std::vector<uint32_t> found, expected;
    grid.Find(features, centre_px, radius_px, min_octave, max_octave, &found);
    for (uint32_t i = 0; i < features.size(); ++i) {
      const Eigen::Vector2d offset = features.pixels_px[i].cast<double>() - centre_px;
      const bool in_octaves = features.octaves[i] >= min_octave && features.octaves[i] <= max_octave;
      if (in_octaves && offset.cwiseAbs().maxCoeff() <= radius_px) expected.push_back(i);
    }
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, expected);
  }
}

TEST(FeatureGrid, OrdersByCellThenIndexAndAppends) {
  FeatureSet features = RandomFeatures(4, 3);
  features.pixels_px = {
      {20, 20}, {5, 5}, {21, 21}, {6, 6}};  // two in the second cell of the diagonal, two in the first
  const FeatureGrid grid(features, kWidth, kHeight);
  std::vector<uint32_t> found = {99};
  grid.Find(features, {10, 10}, 30, 0, 7, &found);
  EXPECT_EQ(found, (std::vector<uint32_t>{99, 1, 3, 0, 2}));
}

TEST(FeatureGrid, FindsNothingInEmptyOrFarOrNanWindows) {
  std::vector<uint32_t> found;
  FeatureGrid().Find(FeatureSet(), {10, 10}, 100, 0, 7, &found);
  const FeatureGrid empty(FeatureSet(), kWidth, kHeight);
  empty.Find(FeatureSet(), {10, 10}, 100, 0, 7, &found);
  const FeatureSet features = RandomFeatures(100, 4);
  const FeatureGrid grid(features, kWidth, kHeight);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  grid.Find(features, {nan, 10}, 100, 0, 7, &found);
  grid.Find(features, {1e12, -1e12}, 100, 0, 7, &found);
  grid.Find(features, {100, 100}, -1, 0, 7, &found);
  EXPECT_TRUE(found.empty());
}

TEST(FeatureGrid, HoldsAsManyAsTwoBytesCount) {
  FeatureSet features;
  features.pixels_px.assign(FeatureGrid::kMaxFeatures, {5, 5});
  features.pixels_px.back() = {kWidth - 5, kHeight - 5};
  features.octaves.resize(features.size());
  std::vector<uint32_t> found;
  FeatureGrid(features, kWidth, kHeight).Find(features, {kWidth - 5, kHeight - 5}, 1, 0, 7, &found);
  EXPECT_EQ(found, (std::vector<uint32_t>{FeatureGrid::kMaxFeatures - 1}));
  features.pixels_px.push_back({5, 5});
  EXPECT_THROW(FeatureGrid(features, kWidth, kHeight), CheckFailure);
}

}  // namespace
}  // namespace portolan
