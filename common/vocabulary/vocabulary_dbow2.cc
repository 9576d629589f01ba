#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <string_view>

#include "vocabulary/vocabulary_file.h"

namespace portolan {
namespace {

using Node = Vocabulary::Node;

/// A node as the text has it; nodes are numbered by line from 1, the root is 0.
struct TextNode {
  uint32_t parent = 0;
  bool is_word = false;
  Descriptor descriptor{};
  float weight = 0;
};

/// Takes the next number off a line. @return false if none is there or it does not fit.
template <class T>
bool TakeNumber(std::string_view* line, T* value) {
  line->remove_prefix(std::min(line->find_first_not_of(" \t\r"), line->size()));
  const std::from_chars_result result = std::from_chars(line->data(), line->data() + line->size(), *value);
  if (result.ec != std::errc()) return false;
  line->remove_prefix(static_cast<size_t>(result.ptr - line->data()));
  return true;
}

bool IsBlank(std::string_view line) {
  return line.find_first_not_of(" \t\r") == std::string_view::npos;
}

/// Reads "parent is_leaf 32 bytes weight". @param number of the node.
bool ReadNode(std::string_view line, uint32_t number, TextNode* node) {
  int is_leaf = 0;
  if (!TakeNumber(&line, &node->parent) || !TakeNumber(&line, &is_leaf)) return false;
  if (node->parent >= number || (is_leaf != 0 && is_leaf != 1)) return false;
  for (size_t i = 0; i < 32; ++i) {
    uint8_t byte = 0;
    if (!TakeNumber(&line, &byte)) return false;
    node->descriptor[i / 8] |= uint64_t{byte} << (8 * (i % 8));
  }
  node->is_word = is_leaf == 1;
  return TakeNumber(&line, &node->weight) && IsBlank(line);
}

/// Reads "k L scoring weighting"; scoring 0 is L1, weighting 0 is tf-idf. @return what is wrong, empty if nothing.
std::string ReadHeader(std::string_view line, int* branching, int* depth) {
  int scoring = -1, weighting = -1;
  if (!TakeNumber(&line, branching) || !TakeNumber(&line, depth) || !TakeNumber(&line, &scoring) ||
      !TakeNumber(&line, &weighting) || !IsBlank(line)) {
    return "expected 'k L scoring weighting'";
  }
  if (scoring != 0 || weighting != 0) {
    return fmt::format("scoring {} and weighting {}, expected 0 (L1) and 0 (tf-idf)", scoring, weighting);
  }
  return {};
}

/// Reorders nodes breadth first, children of a node together in the order of their lines; words keep that order, too.
std::vector<Node> ToBreadthFirst(const std::vector<TextNode>& text) {
  std::vector<std::vector<uint32_t>> children(text.size());
  std::vector<uint32_t> word(text.size(), Node::kNoWord);
  uint32_t num_words = 0;
  for (uint32_t i = 1; i < text.size(); ++i) {
    children[text[i].parent].push_back(i);
    if (text[i].is_word) word[i] = num_words++;
  }
  std::vector<uint32_t> order = {0};  // grows while it is walked
  std::vector<Node> nodes;
  nodes.reserve(text.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const uint32_t number = order[i];
    Node node;
    node.descriptor = text[number].descriptor;
    node.num_children = static_cast<uint32_t>(children[number].size());
    node.first_child = node.num_children > 0 ? static_cast<uint32_t>(order.size()) : 0;
    node.weight = text[number].is_word ? text[number].weight : 0;
    node.word = word[number];
    nodes.push_back(node);
    order.insert(order.end(), children[number].begin(), children[number].end());
  }
  return nodes;
}

}  // namespace

Result<std::shared_ptr<const Vocabulary>> Vocabulary::ReadDbow2Text(const std::string& path) {
  const auto failure = [&](size_t line_number, const std::string& what) {
    return Error{fmt::format("vocabulary {}, line {}: {}", path, line_number, what)};
  };
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line)) return Error{fmt::format("vocabulary {}: cannot be read or is empty", path)};
  int branching = 0, depth = 0;
  if (const std::string fault = ReadHeader(line, &branching, &depth); !fault.empty()) return failure(1, fault);
  std::vector<TextNode> text(1);
  for (size_t line_number = 2; std::getline(file, line); ++line_number) {
    if (IsBlank(line)) continue;
    const auto number = static_cast<uint32_t>(text.size());
    if (!ReadNode(line, number, &text.emplace_back())) {
      return failure(line_number, "expected 'parent is_leaf', 32 bytes and a weight, the parent above its children");
    }
  }
  if (file.bad()) return Error{fmt::format("vocabulary {}: reading failed", path)};
  return VocabularyBuilder::FromNodes(branching, depth, ToBreadthFirst(text), path);
}

}  // namespace portolan
