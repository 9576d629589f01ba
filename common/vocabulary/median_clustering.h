#pragma once

#include <cstdint>
#include <vector>

#include "base/random.h"
#include "features/feature_set.h"

namespace portolan {

/// Clusters of binary descriptors: no cluster is empty.
struct MedianClusters {
  std::vector<Descriptor> medians;
  std::vector<uint32_t> cluster_of;  ///< per descriptor
};

/// The bitwise majority of descriptors, which has the least sum of Hamming distances to them; ties give 0.
class MajorityVote {
 public:
  void Add(const Descriptor& descriptor);
  uint32_t count() const { return count_; }
  Descriptor Median() const;

 private:
  std::vector<uint32_t> ones_ = std::vector<uint32_t>(256, 0);  // per bit
  uint32_t count_ = 0;
};

/// k-medians in Hamming space: k-means++ seeding, then Lloyd's iterations until no descriptor changes its cluster.
/// @param k at least 1. @return at most k clusters: fewer if there are fewer distinct descriptors or clusters run
/// empty.
MedianClusters ClusterByMedians(const std::vector<Descriptor>& descriptors, int k, int max_iterations, Random* random);

}  // namespace portolan
