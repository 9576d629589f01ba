#include "vocabulary/median_clustering.h"

#include <algorithm>

#include "base/check.h"

namespace portolan {
namespace {

/// Seeds as k-means++ does: each next one drawn with probability proportional to the squared distance to the nearest
/// before. Between binary vectors the squared Euclidean distance is the Hamming distance.
std::vector<Descriptor> DrawSeeds(const std::vector<Descriptor>& descriptors, int k, Random* random) {
  std::vector<Descriptor> seeds = {descriptors[random->Below(descriptors.size())]};
  std::vector<uint32_t> distance(descriptors.size(), 256);
  while (static_cast<int>(seeds.size()) < k) {
    uint64_t sum = 0;
    for (size_t i = 0; i < descriptors.size(); ++i) {
      distance[i] = std::min(distance[i], static_cast<uint32_t>(HammingDistance(descriptors[i], seeds.back())));
      sum += distance[i];
    }
    if (sum == 0) break;  // every descriptor is a seed
    uint64_t draw = random->Below(sum);
    size_t chosen = 0;
    while (draw >= distance[chosen]) draw -= distance[chosen++];
    seeds.push_back(descriptors[chosen]);
  }
  return seeds;
}

/// Puts each descriptor to its nearest median, of equals the first. @return whether one changed.
bool Assign(const std::vector<Descriptor>& descriptors, MedianClusters* clusters) {
  bool changed = false;
  for (size_t i = 0; i < descriptors.size(); ++i) {
    uint32_t nearest = 0;
    int nearest_distance = 257;
    for (uint32_t c = 0; c < clusters->medians.size(); ++c) {
      const int distance = HammingDistance(descriptors[i], clusters->medians[c]);
      if (distance >= nearest_distance) continue;
      nearest = c;
      nearest_distance = distance;
    }
    changed |= clusters->cluster_of[i] != nearest;
    clusters->cluster_of[i] = nearest;
  }
  return changed;
}

void UpdateMedians(const std::vector<Descriptor>& descriptors, MedianClusters* clusters) {
  std::vector<MajorityVote> votes(clusters->medians.size());
  for (size_t i = 0; i < descriptors.size(); ++i) votes[clusters->cluster_of[i]].Add(descriptors[i]);
  for (size_t c = 0; c < votes.size(); ++c) {
    if (votes[c].count() > 0) clusters->medians[c] = votes[c].Median();  // an empty one may yet win descriptors back
  }
}

void DropEmpty(MedianClusters* clusters) {
  std::vector<uint32_t> members(clusters->medians.size(), 0);
  for (uint32_t cluster : clusters->cluster_of) ++members[cluster];
  std::vector<uint32_t> new_number(clusters->medians.size(), 0);
  std::vector<Descriptor> kept;
  for (size_t c = 0; c < members.size(); ++c) {
    new_number[c] = static_cast<uint32_t>(kept.size());
    if (members[c] > 0) kept.push_back(clusters->medians[c]);
  }
  for (uint32_t& cluster : clusters->cluster_of) cluster = new_number[cluster];
  clusters->medians = std::move(kept);
}

}  // namespace

void MajorityVote::Add(const Descriptor& descriptor) {
  for (size_t word = 0; word < descriptor.size(); ++word) {
    for (size_t bit = 0; bit < 64; ++bit) ones_[word * 64 + bit] += descriptor[word] >> bit & 1u;
  }
  ++count_;
}

Descriptor MajorityVote::Median() const {
  Descriptor median{};
  for (size_t bit = 0; bit < ones_.size(); ++bit) {
    median[bit / 64] |= uint64_t{2 * uint64_t{ones_[bit]} > count_} << (bit % 64);
  }
  return median;
}

MedianClusters ClusterByMedians(const std::vector<Descriptor>& descriptors, int k, int max_iterations, Random* random) {
  PORTOLAN_CHECK(!descriptors.empty() && k >= 1) << descriptors.size() << " descriptors, k " << k;
  MedianClusters clusters;
  clusters.medians = DrawSeeds(descriptors, k, random);
  clusters.cluster_of.assign(descriptors.size(), 0);
  Assign(descriptors, &clusters);
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    UpdateMedians(descriptors, &clusters);
    if (!Assign(descriptors, &clusters)) break;
  }
  DropEmpty(&clusters);
  return clusters;
}

}  // namespace portolan
