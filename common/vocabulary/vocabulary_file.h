#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "base/result.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// A node of the tree, in memory and in the file. Node 0 is the root, whose descriptor has no meaning; a node without
/// children is a word.
struct Vocabulary::Node {
  Descriptor descriptor{};    ///< the node's median
  uint32_t first_child = 0;   ///< index of the first child, 0 for a word
  uint32_t num_children = 0;  ///< they follow each other
  float weight = 0;           ///< inverse document frequency of a word, ln(N / n_i); 0 inside of the tree
  uint32_t word = kNoWord;    ///< number of the word, 0 to num_words - 1

  static constexpr uint32_t kNoWord = 0xffffffffu;
};
static_assert(sizeof(Vocabulary::Node) == 48, "the file's layout, without padding");

/// The file is this header and then num_nodes nodes, all in little-endian order.
struct VocabularyHeader {
  char magic[8] = {'P', 'O', 'R', 'T', 'V', 'O', 'C', '\n'};
  uint32_t version = 1;
  uint32_t branching = 0, depth = 0;
  uint32_t num_nodes = 0;
  uint32_t node_bytes = sizeof(Vocabulary::Node);
  uint32_t reserved = 0;
  uint64_t hash = 0;  ///< over branching, depth and the nodes: Vocabulary::hash()
};
static_assert(sizeof(VocabularyHeader) == 40, "the file's layout, without padding");

/// Index of the child of `parent` (which has children) nearest to the descriptor; of equals the first.
inline uint32_t NearestChild(const Vocabulary::Node* nodes, const Vocabulary::Node& parent,
                             const Descriptor& descriptor) {
  // Distance and index in one number: the least of them is found without a branch, which half of the time would be
  // foretold wrongly.
  uint64_t nearest = std::numeric_limits<uint64_t>::max();
  for (uint32_t child = parent.first_child; child < parent.first_child + parent.num_children; ++child) {
    const auto distance = static_cast<uint64_t>(HammingDistance(nodes[child].descriptor, descriptor));
    nearest = std::min(nearest, distance << 32 | child);
  }
  return static_cast<uint32_t>(nearest);
}

/// Makes vocabularies, out of nodes or of a file.
class VocabularyBuilder {
 public:
  /// @param nodes breadth first, children of a node contiguous and behind it. @param origin names the source in errors.
  /// Fails if they are no tree of at most `branching` children and `depth` levels with its words numbered 0 to n - 1.
  static Result<std::shared_ptr<const Vocabulary>> FromNodes(int branching, int depth,
                                                             std::vector<Vocabulary::Node> nodes,
                                                             const std::string& origin);

  /// Maps a file that SaveVocabulary wrote; see Vocabulary::Open.
  static Result<std::shared_ptr<const Vocabulary>> FromFile(const std::string& path);

  /// The nodes of a vocabulary, num_nodes() of them.
  static const Vocabulary::Node* Nodes(const Vocabulary& vocabulary) { return vocabulary.nodes_; }

 private:
  static Result<std::shared_ptr<const Vocabulary>> Build(uint32_t branching, uint32_t depth,
                                                         std::unique_ptr<Vocabulary::Storage> storage,
                                                         const Vocabulary::Node* nodes, size_t num_nodes,
                                                         const std::string& origin);
};

/// Writes the compact binary file, whole or not at all: a failure leaves what was there before.
Status SaveVocabulary(const Vocabulary& vocabulary, const std::string& path);

}  // namespace portolan
