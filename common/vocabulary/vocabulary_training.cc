#include "vocabulary/vocabulary_training.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "vocabulary/median_clustering.h"
#include "vocabulary/vocabulary_file.h"

namespace portolan {
namespace {

using Node = Vocabulary::Node;

/// A node yet to be divided, with the descriptors that fall into it.
struct PendingNode {
  int level = 0;
  std::vector<Descriptor> descriptors;
};

/// Counts descriptors that have come down a level, for the progress.
class WorkMeter {
 public:
  WorkMeter(size_t num_descriptors, int depth, const TrainingProgress& progress)
      : total_(static_cast<double>(num_descriptors) * depth), progress_(progress) {}
  void Add(size_t descriptor_levels) {
    done_ += static_cast<double>(descriptor_levels);
    if (progress_) progress_(done_ / total_);
  }

 private:
  const double total_;
  const TrainingProgress& progress_;
  double done_ = 0;
};

/// Divides nodes breadth first, from the root down, into clusters that become their children.
std::vector<Node> GrowTree(std::vector<Descriptor> descriptors, const VocabularyTrainingOptions& options,
                           WorkMeter* meter) {
  Random random(options.seed);
  std::vector<Node> nodes(1);
  std::vector<PendingNode> pending = {{0, std::move(descriptors)}};  // parallel to nodes
  for (size_t i = 0; i < nodes.size(); ++i) {
    const PendingNode node = std::move(pending[i]);
    if (node.level == options.depth) continue;
    MedianClusters clusters = ClusterByMedians(node.descriptors, options.branching, options.max_iterations, &random);
    if (clusters.medians.size() < 2) {  // one descriptor, over and over: a word above the lowest level
      meter->Add(node.descriptors.size() * static_cast<size_t>(options.depth - node.level));
      continue;
    }
    nodes[i].first_child = static_cast<uint32_t>(nodes.size());
    nodes[i].num_children = static_cast<uint32_t>(clusters.medians.size());
    for (const Descriptor& median : clusters.medians) {
      nodes.emplace_back().descriptor = median;
      pending.push_back({node.level + 1, {}});
    }
    for (size_t d = 0; d < node.descriptors.size(); ++d) {
      pending[nodes[i].first_child + clusters.cluster_of[d]].descriptors.push_back(node.descriptors[d]);
    }
    meter->Add(node.descriptors.size());
  }
  return nodes;
}

uint32_t FindLeaf(const std::vector<Node>& nodes, const Descriptor& descriptor) {
  uint32_t index = 0;
  while (nodes[index].num_children > 0) index = NearestChild(nodes.data(), nodes[index], descriptor);
  return index;
}

/// Numbers the words and weights them with ln(N / n_i), n_i the number of the N images that show the word; one that
/// none shows, because the medians moved on after it was made, counts as rare as can be.
void WeightWords(const std::vector<std::vector<Descriptor>>& images, std::vector<Node>* nodes) {
  std::vector<uint32_t> images_with(nodes->size(), 0);
  for (const std::vector<Descriptor>& image : images) {
    std::vector<uint32_t> leaves;
    for (const Descriptor& descriptor : image) leaves.push_back(FindLeaf(*nodes, descriptor));
    std::sort(leaves.begin(), leaves.end());
    leaves.erase(std::unique(leaves.begin(), leaves.end()), leaves.end());
    for (uint32_t leaf : leaves) ++images_with[leaf];
  }
  uint32_t next_word = 0;
  for (size_t i = 0; i < nodes->size(); ++i) {
    Node& node = (*nodes)[i];
    if (node.num_children > 0) continue;
    node.word = next_word++;
    node.weight = static_cast<float>(std::log(static_cast<double>(images.size()) / std::max(1u, images_with[i])));
  }
}

}  // namespace

Status VocabularyTrainingOptions::Check() const {
  if (branching < 2 || branching > 100) return Error{fmt::format("branching is {}, expected 2 to 100", branching)};
  if (depth < 1 || depth > 10) return Error{fmt::format("depth is {}, expected 1 to 10", depth)};
  if (max_iterations < 1) return Error{fmt::format("max_iterations is {}, expected at least 1", max_iterations)};
  return Ok{};
}

Result<std::shared_ptr<const Vocabulary>> TrainVocabulary(const std::vector<std::vector<Descriptor>>& images,
                                                          const VocabularyTrainingOptions& options,
                                                          const TrainingProgress& progress) {
  if (const Status status = options.Check(); !status) return status.error();
  std::vector<Descriptor> descriptors;
  for (const std::vector<Descriptor>& image : images) descriptors.insert(descriptors.end(), image.begin(), image.end());
  if (descriptors.size() < static_cast<size_t>(options.branching)) {
    return Error{fmt::format("{} descriptors in {} training images, expected at least {}", descriptors.size(),
                             images.size(), options.branching)};
  }
  WorkMeter meter(descriptors.size(), options.depth, progress);
  std::vector<Node> nodes = GrowTree(std::move(descriptors), options, &meter);
  WeightWords(images, &nodes);
  return VocabularyBuilder::FromNodes(options.branching, options.depth, std::move(nodes), "from training");
}

}  // namespace portolan
