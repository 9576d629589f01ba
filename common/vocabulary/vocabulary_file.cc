#include "vocabulary/vocabulary_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "base/atomic_file.h"
#include "base/hash.h"
#include "vocabulary/vocabulary_storage.h"

namespace portolan {
namespace {

using Node = Vocabulary::Node;

// Far beyond any useful tree: files that ask for more are damaged.
constexpr uint32_t kMaxBranching = 256, kMaxDepth = 32;

uint64_t HashTree(uint32_t branching, uint32_t depth, const Node* nodes, size_t num_nodes) {
  Hasher hasher;
  hasher.Add(branching);
  hasher.Add(depth);
  hasher.AddBytes(nodes, num_nodes * sizeof(Node));
  return hasher.Value();
}

/// Checks that nodes form a tree in breadth-first order: each node's children begin where those of the one before end.
/// @return the number of words.
Result<uint32_t> CheckTree(const Node* nodes, size_t num_nodes, uint32_t branching, uint32_t depth) {
  if (branching < 2 || branching > kMaxBranching || depth < 1 || depth > kMaxDepth) {
    return Error{fmt::format("{} children a node and {} levels, expected 2 to {} and 1 to {}", branching, depth,
                             kMaxBranching, kMaxDepth)};
  }
  std::vector<uint8_t> level(num_nodes, 0);
  std::vector<bool> is_word_taken(num_nodes, false);
  uint32_t next_child = 1, num_words = 0, last_word = 0;
  for (size_t i = 0; i < num_nodes; ++i) {
    const Node& node = nodes[i];
    if (node.num_children == 0) {
      if (node.word >= num_nodes || is_word_taken[node.word]) {
        return Error{fmt::format("node {} has word {}", i, node.word)};
      }
      if (!(node.weight >= 0 && node.weight < 1e6f)) return Error{fmt::format("node {} has weight {}", i, node.weight)};
      is_word_taken[node.word] = true;
      last_word = std::max(last_word, node.word);
      ++num_words;
      continue;
    }
    if (node.num_children > branching || level[i] >= depth || node.first_child != next_child || node.first_child <= i ||
        node.num_children > num_nodes - next_child) {
      return Error{fmt::format("node {} has {} children from node {}", i, node.num_children, node.first_child)};
    }
    for (uint32_t c = 0; c < node.num_children; ++c) level[next_child++] = static_cast<uint8_t>(level[i] + 1);
  }
  if (num_nodes < 2 || next_child != num_nodes) {
    return Error{fmt::format("{} of {} nodes hang together", next_child, num_nodes)};
  }
  if (last_word + 1 != num_words) return Error{fmt::format("{} words, numbered up to {}", num_words, last_word)};
  return num_words;
}

Error Failure(const std::string& path, const std::string& what) {
  return Error{fmt::format("vocabulary {}: {}", path, what)};
}

/// Checks a header against the file's size. @return what is wrong, empty if nothing.
std::string FindFault(const VocabularyHeader& header, uint64_t file_bytes) {
  const VocabularyHeader expected;
  if (std::memcmp(header.magic, expected.magic, sizeof header.magic) != 0) {
    return "not a Portolan vocabulary (DBoW2 text is read by `portolan_vocabulary convert`)";
  }
  if (header.version != expected.version || header.node_bytes != expected.node_bytes) {
    return fmt::format("version {} with nodes of {} bytes, expected version {} with {}", header.version,
                       header.node_bytes, expected.version, expected.node_bytes);
  }
  if (header.reserved != 0) return "a header field that must be 0 is not: damaged";
  const uint64_t expected_bytes = sizeof(VocabularyHeader) + uint64_t{header.num_nodes} * sizeof(Node);
  if (file_bytes != expected_bytes)
    return fmt::format("{} bytes long, expected {}: cut short?", file_bytes, expected_bytes);
  return {};
}

}  // namespace

Result<std::shared_ptr<const Vocabulary>> VocabularyBuilder::Build(uint32_t branching, uint32_t depth,
                                                                   std::unique_ptr<Vocabulary::Storage> storage,
                                                                   const Node* nodes, size_t num_nodes,
                                                                   const std::string& origin) {
  const Result<uint32_t> num_words = CheckTree(nodes, num_nodes, branching, depth);
  if (!num_words) return Failure(origin, "no tree of words: " + num_words.error().message);
  std::shared_ptr<Vocabulary> vocabulary(new Vocabulary());
  vocabulary->storage_ = std::move(storage);
  vocabulary->nodes_ = nodes;
  vocabulary->num_nodes_ = static_cast<uint32_t>(num_nodes);
  vocabulary->num_words_ = *num_words;
  vocabulary->branching_ = static_cast<int>(branching);
  vocabulary->depth_ = static_cast<int>(depth);
  vocabulary->hash_ = HashTree(branching, depth, nodes, num_nodes);
  return std::shared_ptr<const Vocabulary>(std::move(vocabulary));
}

Result<std::shared_ptr<const Vocabulary>> VocabularyBuilder::FromNodes(int branching, int depth,
                                                                       std::vector<Node> nodes,
                                                                       const std::string& origin) {
  auto storage = std::make_unique<Vocabulary::Storage>();
  storage->nodes = std::move(nodes);
  const Node* data = storage->nodes.data();
  const size_t num_nodes = storage->nodes.size();
  return Build(static_cast<uint32_t>(branching), static_cast<uint32_t>(depth), std::move(storage), data, num_nodes,
               origin);
}

Result<std::shared_ptr<const Vocabulary>> VocabularyBuilder::FromFile(const std::string& path) {
  auto storage = std::make_unique<Vocabulary::Storage>();
  if (const std::string fault = storage->Map(path); !fault.empty()) return Failure(path, fault);
  VocabularyHeader header;
  if (storage->mapping_bytes < sizeof header) {
    return Failure(path, fmt::format("{} bytes long, shorter than a header", storage->mapping_bytes));
  }
  std::memcpy(&header, storage->mapping, sizeof header);
  if (const std::string fault = FindFault(header, storage->mapping_bytes); !fault.empty()) return Failure(path, fault);
  const auto* nodes = reinterpret_cast<const Node*>(static_cast<const char*>(storage->mapping) + sizeof header);
  const uint64_t hash = HashTree(header.branching, header.depth, nodes, header.num_nodes);
  if (hash != header.hash) {
    return Failure(path, fmt::format("checksum of the content is {}, expected {}: damaged", FormatHash(hash),
                                     FormatHash(header.hash)));
  }
  return Build(header.branching, header.depth, std::move(storage), nodes, header.num_nodes, path);
}

Status SaveVocabulary(const Vocabulary& vocabulary, const std::string& path) {
  VocabularyHeader header;
  header.branching = static_cast<uint32_t>(vocabulary.branching());
  header.depth = static_cast<uint32_t>(vocabulary.depth());
  header.num_nodes = vocabulary.num_nodes();
  header.hash = vocabulary.hash();
  std::string content(reinterpret_cast<const char*>(&header), sizeof header);
  content.append(reinterpret_cast<const char*>(VocabularyBuilder::Nodes(vocabulary)),
                 vocabulary.num_nodes() * sizeof(Node));
  const Status status = WriteFileAtomically(path, content);
  if (!status) return Error{"vocabulary " + status.error().message};
  return Ok{};
}

}  // namespace portolan
