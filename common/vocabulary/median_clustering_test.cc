#include "vocabulary/median_clustering.h"

#include <gtest/gtest.h>

#include <set>

#include "vocabulary/test_descriptors.h"

namespace portolan {
namespace {

uint64_t SumOfDistances(const std::vector<Descriptor>& descriptors, const Descriptor& centre) {
  uint64_t sum = 0;
  for (const Descriptor& descriptor : descriptors) sum += static_cast<uint64_t>(HammingDistance(descriptor, centre));
  return sum;
}

TEST(MajorityVote, MinimisesTheSumOfDistances) {
  Random random(1);
  std::vector<Descriptor> descriptors;
  MajorityVote vote;
  for (int i = 0; i < 20; ++i) {
    descriptors.push_back(RandomDescriptor(&random));
    vote.Add(descriptors.back());
  }
  EXPECT_EQ(vote.count(), 20u);
  const Descriptor median = vote.Median();
  const uint64_t least = SumOfDistances(descriptors, median);
  for (size_t bit = 0; bit < 256; ++bit) {
    Descriptor other = median;
    other[bit / 64] ^= uint64_t{1} << (bit % 64);
    EXPECT_GE(SumOfDistances(descriptors, other), least);
  }
}

TEST(ClusterByMedians, FindsWellSeparatedClusters) {
  Random random(2);
  std::vector<Descriptor> centres, descriptors;
  for (int i = 0; i < 5; ++i) centres.push_back(RandomDescriptor(&random));
  for (size_t i = 0; i < 500; ++i) descriptors.push_back(WithNoise(centres[i % 5], 0.05, &random));
  const MedianClusters clusters = ClusterByMedians(descriptors, 5, 20, &random);
  ASSERT_EQ(clusters.medians.size(), 5u);
  for (size_t i = 0; i < descriptors.size(); ++i) {
    EXPECT_EQ(clusters.medians[clusters.cluster_of[i]], centres[i % 5]);  // a hundred votes a bit, 5 % of them wrong
  }
}

TEST(ClusterByMedians, PutsEachDescriptorToItsNearestMedian) {
  Random random(3);
  std::vector<Descriptor> descriptors;
  for (int i = 0; i < 300; ++i) descriptors.push_back(RandomDescriptor(&random));
  const MedianClusters clusters = ClusterByMedians(descriptors, 8, 100, &random);
  std::set<uint32_t> used(clusters.cluster_of.begin(), clusters.cluster_of.end());
  EXPECT_EQ(used.size(), clusters.medians.size());
  for (size_t i = 0; i < descriptors.size(); ++i) {
    const int distance = HammingDistance(descriptors[i], clusters.medians[clusters.cluster_of[i]]);
    for (const Descriptor& median : clusters.medians) EXPECT_LE(distance, HammingDistance(descriptors[i], median));
  }
}

TEST(ClusterByMedians, MakesNoMoreClustersThanDistinctDescriptors) {
  Random random(4);
  const Descriptor a = RandomDescriptor(&random), b = RandomDescriptor(&random);
  EXPECT_EQ(ClusterByMedians({a, a, a, a}, 3, 10, &random).medians.size(), 1u);
  const MedianClusters two = ClusterByMedians({a, b, a, b, a}, 4, 10, &random);
  ASSERT_EQ(two.medians.size(), 2u);
  EXPECT_EQ(two.medians[two.cluster_of[0]], a);
  EXPECT_EQ(two.medians[two.cluster_of[1]], b);
  EXPECT_EQ(two.cluster_of[4], two.cluster_of[0]);
}

}  // namespace
}  // namespace portolan
