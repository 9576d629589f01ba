#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/result.h"
#include "features/feature_matcher.h"
#include "features/feature_set.h"
#include "vocabulary/bow_vector.h"

namespace portolan {

/// A tree of visual words over binary descriptors (Galvez-Lopez and Tardos, TRO 2012), k children a node, L levels.
/// Immutable, thread-safe; opened from a file it is mapped into memory, so processes on a machine share it.
class Vocabulary {
 public:
  /// Opens a compact binary file (vocabulary_file.h). Takes milliseconds. Fails, naming the file and what was expected,
  /// on a file of another kind, another version, cut short or with a wrong checksum.
  static Result<std::shared_ptr<const Vocabulary>> Open(const std::string& path);

  /// The hash of a file that Open takes, for those who compare keyframes' vocabularies but look nothing up: the file
  /// does not stay in memory.
  static Result<uint64_t> HashOf(const std::string& path);

  /// Reads DBoW2's text format: "k L scoring weighting", then a line per node "parent is_leaf 32 bytes weight".
  static Result<std::shared_ptr<const Vocabulary>> ReadDbow2Text(const std::string& path);

  /// The vocabulary installed with Portolan: $PORTOLAN_VOCABULARY if set, else share/portolan/default.pvoc beside the
  /// program's prefix.
  static std::string DefaultPath();

  /// Words and direct index of an image's descriptors in one descent: BowVector of all words with a positive weight,
  /// and the features by node at `direct_level` levels above the leaves (0 is the leaf; deeper trees than that clamp at
  /// the root's children). Nodes beyond the first kMaxDirectNodes are too many for a direct index: the node above them
  /// stands for them. @param descriptors at most kMaxDirectNodes. @param bow null: only the direct index is wanted, and
  /// the descent ends at its level.
  void Transform(const std::vector<Descriptor>& descriptors, int direct_level, BowVector* bow,
                 NodeFeatures* nodes) const;

  static constexpr size_t kMaxDirectNodes = size_t{1} << 16;  ///< what NodeFeatures can count

  uint32_t num_words() const { return num_words_; }
  uint32_t num_nodes() const { return num_nodes_; }
  int branching() const { return branching_; }
  int depth() const { return depth_; }
  /// Identifies the content; travels in messages so that processes with different vocabularies notice.
  uint64_t hash() const { return hash_; }

  ~Vocabulary();
  Vocabulary(const Vocabulary&) = delete;
  Vocabulary& operator=(const Vocabulary&) = delete;

  struct Node;  // layout in vocabulary_file.h

 private:
  friend class VocabularyBuilder;
  Vocabulary() = default;

  const Node* nodes_ = nullptr;  // num_nodes_, breadth first: children of a node are contiguous
  uint32_t num_nodes_ = 0, num_words_ = 0;
  int branching_ = 0, depth_ = 0;
  uint64_t hash_ = 0;
  struct Storage;
  std::unique_ptr<Storage> storage_;  // the mapping or the owned nodes
};

}  // namespace portolan
