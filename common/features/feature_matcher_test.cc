#include "features/feature_matcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "base/random.h"

namespace portolan {
namespace {

constexpr int kSize = 400;  // of the square image, pixels
const double kNan = std::numeric_limits<double>::quiet_NaN();

Descriptor RandomDescriptor(Random* random) {
  return {random->Next(), random->Next(), random->Next(), random->Next()};
}

/// The descriptor with `count` of its bits flipped, each another one.
Descriptor Flip(Descriptor descriptor, int count) {
  for (int bit = 0; bit < count; ++bit) descriptor[static_cast<size_t>(bit % 4)] ^= uint64_t{1} << (bit / 4);
  return descriptor;
}

void AddFeature(const Eigen::Vector2f& pixel_px, int octave, float angle_rad, const Descriptor& descriptor,
                FeatureSet* features) {
  features->pixels_px.push_back(pixel_px);
  features->octaves.push_back(static_cast<uint8_t>(octave));
  features->angles_rad.push_back(angle_rad);
  features->descriptors.push_back(descriptor);
}

FeatureSet RandomFeatures(int count, uint64_t seed) {
  Random random(seed);
  FeatureSet features;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2f pixel_px(static_cast<float>(random.Uniform(0, kSize - 1)),
                                   static_cast<float>(random.Uniform(0, kSize - 1)));
    AddFeature(pixel_px, static_cast<int>(random.Below(8)), static_cast<float>(random.Uniform(0, 2 * M_PI)),
               RandomDescriptor(&random), &features);
  }
  return features;
}

/// Another view of the features: in reverse order, a few bits flipped, moved, turned.
FeatureSet SecondView(const FeatureSet& first, const Eigen::Vector2f& motion_px, float turn_rad) {
  FeatureSet second;
  for (size_t i = first.size(); i-- > 0;) {
    AddFeature(first.pixels_px[i] + motion_px, first.octaves[i],
               std::fmod(first.angles_rad[i] + turn_rad, static_cast<float>(2 * M_PI)), Flip(first.descriptors[i], 10),
               &second);
  }
  return second;
}

NodeFeatures NodesByModulus(const FeatureSet& features, bool reversed) {
  NodeFeatures nodes;
  for (uint32_t i = 0; i < features.size(); ++i) {
    const auto original = reversed ? static_cast<uint32_t>(features.size()) - 1 - i : i;
    nodes.emplace_back(original % 7, i);
  }
  std::sort(nodes.begin(), nodes.end());
  return nodes;
}

std::vector<Eigen::Vector2d> Predict(const FeatureSet& first, const Eigen::Vector2d& motion_px) {
  std::vector<Eigen::Vector2d> predicted_px;
  for (const Eigen::Vector2f& pixel_px : first.pixels_px) predicted_px.push_back(pixel_px.cast<double>() + motion_px);
  return predicted_px;
}

void ExpectReversedMatches(const std::vector<FeatureMatch>& matches, uint32_t count) {
  ASSERT_EQ(matches.size(), count);
  for (uint32_t i = 0; i < count; ++i) {
    EXPECT_EQ(matches[i].first, i);
    EXPECT_EQ(matches[i].second, count - 1 - i);
    EXPECT_EQ(matches[i].distance, 10);
  }
}

TEST(MatchByNodes, FindsEveryFeatureAgain) {
  const FeatureSet first = RandomFeatures(300, 1), second = SecondView(first, {3, 4}, 1.0f);
  ExpectReversedMatches(
      MatchByNodes(first, NodesByModulus(first, false), second, NodesByModulus(second, true), {}, nullptr, nullptr),
      300);
}

TEST(MatchByNodes, MatchesOnlyWithinANode) {
  const FeatureSet first = RandomFeatures(50, 2), second = SecondView(first, {0, 0}, 0);
  NodeFeatures first_nodes, second_nodes;
  for (uint32_t i = 0; i < 50; ++i) first_nodes.emplace_back(2 * i, i);
  for (uint32_t i = 0; i < 50; ++i) second_nodes.emplace_back(2 * i + 1, i);
  EXPECT_TRUE(MatchByNodes(first, first_nodes, second, second_nodes, {}, nullptr, nullptr).empty());
  EXPECT_TRUE(MatchByNodes(first, {}, second, second_nodes, {}, nullptr, nullptr).empty());
}

TEST(MatchByNodes, UsesSelectedFeaturesOnly) {
  const FeatureSet first = RandomFeatures(100, 3), second = SecondView(first, {0, 0}, 0);
  const auto matches = MatchByNodes(
      first, NodesByModulus(first, false), second, NodesByModulus(second, true), {},
      [](uint32_t i) { return i % 2 == 0; }, [](uint32_t j) { return j >= 50; });
  EXPECT_EQ(matches.size(), 25u);  // even ones of the first fifty
  for (const FeatureMatch& match : matches) {
    EXPECT_EQ(match.first % 2, 0u);
    EXPECT_GE(match.second, 50u);
  }
}

TEST(MatchByWindow, FindsEveryFeatureAgain) {
  const FeatureSet first = RandomFeatures(300, 4), second = SecondView(first, {3, 4}, 1.0f);
  const FeatureGrid grid(second, kSize + 10, kSize + 10);
  ExpectReversedMatches(MatchByWindow(first, Predict(first, {3, 4}), second, grid, 5, {}), 300);
  EXPECT_TRUE(MatchByWindow(first, Predict(first, {0, 0}), second, grid, 2.9, {}).size() < 10);
}

TEST(MatchByWindow, SkipsNanAndOtherOctaves) {
  FeatureSet first = RandomFeatures(20, 5), second = SecondView(first, {0, 0}, 0);
  std::vector<Eigen::Vector2d> predicted_px = Predict(first, {0, 0});
  predicted_px[3] = {kNan, kNan};
  first.octaves[4] = 0;
  second.octaves[20 - 1 - 4] = 2;
  first.octaves[5] = 6;
  second.octaves[20 - 1 - 5] = 7;
  std::set<uint32_t> matched;
  const auto matches = MatchByWindow(first, predicted_px, second, FeatureGrid(second, kSize, kSize), 5, {});
  for (const FeatureMatch& match : matches) matched.insert(match.first);
  EXPECT_EQ(matched.count(3), 0u);
  EXPECT_EQ(matched.count(4), 0u);
  EXPECT_EQ(matched.count(5), 1u);
  EXPECT_EQ(matched.size(), 18u);
}

TEST(MatchByWindow, IsOneToOneAndTheCloserWins) {
  Random random(6);
  const Descriptor descriptor = RandomDescriptor(&random);
  FeatureSet first, second;
  AddFeature({100, 100}, 0, 0, Flip(descriptor, 20), &first);
  AddFeature({101, 100}, 0, 0, Flip(descriptor, 5), &first);
  AddFeature({102, 100}, 0, 0, Flip(descriptor, 30), &first);
  AddFeature({100, 101}, 0, 0, descriptor, &second);
  const auto matches = MatchByWindow(first, Predict(first, {0, 0}), second, FeatureGrid(second, kSize, kSize), 5, {});
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].first, 1u);
  EXPECT_EQ(matches[0].distance, 5);
}

TEST(MatchByWindow, ManyWantingFewStaysOneToOne) {
  FeatureSet first = RandomFeatures(400, 7), second = RandomFeatures(40, 8);
  MatcherOptions options;
  options.max_distance = 256;
  options.ratio = 1;
  options.check_orientation = false;
  const auto matches =
      MatchByWindow(first, Predict(first, {0, 0}), second, FeatureGrid(second, kSize, kSize), 100, options);
  std::set<uint32_t> firsts, seconds;
  for (const FeatureMatch& match : matches) {
    firsts.insert(match.first);
    seconds.insert(match.second);
  }
  EXPECT_EQ(firsts.size(), matches.size());
  EXPECT_EQ(seconds.size(), matches.size());
  EXPECT_GT(matches.size(), 30u);
}

/// One feature, and two candidates at 20 and 24 bits from it.
std::vector<FeatureMatch> MatchAmongTwo(const Eigen::Vector2f& rival_px, int rival_octave,
                                        const MatcherOptions& options) {
  Random random(9);
  const Descriptor descriptor = RandomDescriptor(&random);
  FeatureSet first, second;
  AddFeature({100, 100}, 1, 0, descriptor, &first);
  AddFeature({100, 101}, 1, 0, Flip(descriptor, 20), &second);
  AddFeature(rival_px, rival_octave, 0, Flip(descriptor, 24), &second);
  return MatchByWindow(first, Predict(first, {0, 0}), second, FeatureGrid(second, kSize, kSize), 20, options);
}

TEST(MatchByWindow, RefusesAmbiguousAndDistantDescriptors) {
  MatcherOptions options;
  EXPECT_TRUE(MatchAmongTwo({110, 101}, 1, options).empty());  // 20 / 24 is over 0.8
  options.ratio = 0.9;
  EXPECT_EQ(MatchAmongTwo({110, 101}, 1, options).size(), 1u);
  options.ratio = 1;
  EXPECT_EQ(MatchAmongTwo({110, 101}, 1, options).size(), 1u);
  options.max_distance = 19;
  EXPECT_TRUE(MatchAmongTwo({110, 101}, 1, options).empty());
}

TEST(MatchByWindow, OneCornerOnTwoLevelsIsNoRivalOfItself) {
  EXPECT_EQ(MatchAmongTwo({101, 102}, 2, {}).size(), 1u);
  EXPECT_TRUE(MatchAmongTwo({101, 102}, 1, {}).empty());
  EXPECT_TRUE(MatchAmongTwo({110, 102}, 2, {}).empty());
}

TEST(KeepConsistentOrientation, DropsTheMinority) {
  FeatureSet first, second;
  std::vector<FeatureMatch> matches;
  Random random(10);
  for (uint32_t i = 0; i < 100; ++i) {
    const auto angle_rad = static_cast<float>(random.Uniform(0, 2 * M_PI));
    const double turn_rad = i < 90 ? 0.01 * random.Gaussian() : 1.0 + 0.5 * i;  // around no rotation, and all over
    AddFeature({0, 0}, 0, angle_rad, {}, &first);
    AddFeature({0, 0}, 0, static_cast<float>(std::fmod(angle_rad + turn_rad + 2 * M_PI, 2 * M_PI)), {}, &second);
    matches.push_back({i, i, 0});
  }
  const auto kept = KeepConsistentOrientation(first, second, matches);
  ASSERT_GE(kept.size(), 90u);
  EXPECT_LE(kept.size(), 92u);  // some of the strays may turn by nothing, too
  for (uint32_t i = 0; i < 90; ++i) EXPECT_EQ(kept[i].first, i);
  EXPECT_TRUE(KeepConsistentOrientation(first, second, {}).empty());
}

}  // namespace
}  // namespace portolan
