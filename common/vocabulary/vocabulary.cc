#include "vocabulary/vocabulary.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <utility>

#include "base/check.h"
#include "vocabulary/vocabulary_file.h"
#include "vocabulary/vocabulary_storage.h"

namespace portolan {
namespace {

/// A bag of words out of the words of each feature, ascending, with repeats.
BowVector CountWords(const std::vector<std::pair<uint32_t, float>>& words) {
  BowVector bow;
  double sum = 0;
  for (size_t i = 0; i < words.size(); ++i) {
    if (bow.empty() || bow.back().first != words[i].first) bow.emplace_back(words[i].first, 0.0f);
    bow.back().second +=
        words[i].second;  // term frequency times idf; the image's number of features cancels in the L1 norm
    sum += words[i].second;
  }
  for (auto& [word, weight] : bow) weight = static_cast<float>(weight / sum);
  bow.shrink_to_fit();  // kept for as long as its image is
  return bow;
}

}  // namespace

Vocabulary::~Vocabulary() = default;

Result<std::shared_ptr<const Vocabulary>> Vocabulary::Open(const std::string& path) {
  return VocabularyBuilder::FromFile(path);
}

Result<uint64_t> Vocabulary::HashOf(const std::string& path) {
  const auto vocabulary = Open(path);
  if (!vocabulary) return vocabulary.error();
  return (*vocabulary)->hash();
}

std::string Vocabulary::DefaultPath() {
  if (const char* path = std::getenv("PORTOLAN_VOCABULARY"); path != nullptr && *path != '\0') return path;
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  return (program.parent_path() / ".." / "share" / "portolan" / "default.pvoc").lexically_normal().string();
}

void Vocabulary::Transform(const std::vector<Descriptor>& descriptors, int direct_level, BowVector* bow,
                           NodeFeatures* nodes) const {
  PORTOLAN_CHECK(descriptors.size() <= kMaxDirectNodes) << descriptors.size() << " descriptors";
  const int node_level = std::max(1, depth_ - direct_level);
  std::vector<std::pair<uint32_t, float>> words;
  NodeFeatures features_by_node;
  words.reserve(descriptors.size());
  features_by_node.reserve(descriptors.size());
  for (size_t i = 0; i < descriptors.size(); ++i) {
    uint32_t index = 0, node = 0;
    for (int level = 1; (bow != nullptr || level <= node_level) && nodes_[index].num_children > 0; ++level) {
      index = NearestChild(nodes_, nodes_[index], descriptors[i]);
      if (level <= node_level && index < kMaxDirectNodes) node = index;
    }
    if (bow != nullptr && nodes_[index].weight > 0) words.emplace_back(nodes_[index].word, nodes_[index].weight);
    features_by_node.emplace_back(static_cast<uint16_t>(node), static_cast<uint16_t>(i));
  }
  if (bow != nullptr) {
    std::sort(words.begin(), words.end());
    *bow = CountWords(words);
  }
  std::sort(features_by_node.begin(), features_by_node.end(), [](const auto& a, const auto& b) {
    return (uint32_t{a.first} << 16 | a.second) < (uint32_t{b.first} << 16 | b.second);  // in one comparison
  });
  *nodes = std::move(features_by_node);
}

}  // namespace portolan
