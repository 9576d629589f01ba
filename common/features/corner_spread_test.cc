#include "features/corner_spread.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "base/random.h"

namespace portolan {
namespace {

constexpr int kWidth = 640, kHeight = 480;

/// Corners at random places of a rectangle, in rising order of rows as a detector finds them.
std::vector<Corner> RandomCorners(int count, int left, int top, int width, int height, Random* random) {
  std::vector<Corner> corners;
  for (int i = 0; i < count; ++i) {
    Corner corner;
    corner.x = left + static_cast<int>(random->Below(static_cast<uint64_t>(width)));
    corner.y = top + static_cast<int>(random->Below(static_cast<uint64_t>(height)));
    corner.score = static_cast<float>(20 + random->Below(100));
    corners.push_back(corner);
  }
  return corners;
}

TEST(SpreadCorners, KeepsAllOfFew) {
  Random random(1);
  const std::vector<Corner> corners = RandomCorners(50, 0, 0, kWidth, kHeight, &random);
  EXPECT_EQ(SpreadCorners(corners, kWidth, kHeight, 50).size(), 50u);
  EXPECT_EQ(SpreadCorners(corners, kWidth, kHeight, 1000).size(), 50u);
  EXPECT_TRUE(SpreadCorners(corners, kWidth, kHeight, 0).empty());
  EXPECT_TRUE(SpreadCorners({}, kWidth, kHeight, 10).empty());
}

TEST(SpreadCorners, SelectsTheNumberAskedForInOrderAndOnce) {
  Random random(2);
  const std::vector<Corner> corners = RandomCorners(5000, 0, 0, kWidth, kHeight, &random);
  for (int count : {1, 7, 100, 1000, 3000}) {
    const std::vector<uint32_t> selected = SpreadCorners(corners, kWidth, kHeight, count);
    EXPECT_EQ(selected.size(), static_cast<size_t>(count));
    EXPECT_EQ(std::adjacent_find(selected.begin(), selected.end(), std::greater_equal<uint32_t>()), selected.end());
    EXPECT_EQ(selected, SpreadCorners(corners, kWidth, kHeight, count));
  }
}

TEST(SpreadCorners, ThinsOutCrowdsBeforeSparsePlaces) {
  Random random(3);
  std::vector<Corner> corners = RandomCorners(4000, 0, 0, 160, 120, &random);  // a sixteenth of the area
  const size_t num_crowded = corners.size();
  for (Corner corner : RandomCorners(300, 160, 120, 480, 360, &random)) {
    corner.score = 8;  // weaker than all of the crowd
    corners.push_back(corner);
  }
  const std::vector<uint32_t> selected = SpreadCorners(corners, kWidth, kHeight, 400);
  const auto num_sparse = std::count_if(selected.begin(), selected.end(), [&](uint32_t i) { return i >= num_crowded; });
  EXPECT_GT(num_sparse, 200);  // by score alone there would be none, by share of the corners 28
}

TEST(SpreadCorners, KeepsTheStrongestCorner) {
  Random random(4);
  std::vector<Corner> corners = RandomCorners(2000, 0, 0, kWidth, kHeight, &random);
  corners[1234].score = 500;
  for (int count : {1, 10, 500}) {
    EXPECT_THAT(SpreadCorners(corners, kWidth, kHeight, count), testing::Contains(1234u)) << count;
  }
}

}  // namespace
}  // namespace portolan
