#include "vocabulary/vocabulary.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <numeric>

#include "vocabulary/test_descriptors.h"
#include "vocabulary/vocabulary_file.h"
#include "vocabulary/vocabulary_training.h"

namespace portolan {
namespace {

std::shared_ptr<const Vocabulary> SmallVocabulary() {
  VocabularyTrainingOptions options;
  options.branching = 4;
  options.depth = 4;
  return TrainVocabulary(RandomImages(30, 1), options, nullptr).value();
}

/// The nodes that a descriptor goes through, from below the root to its word, found step by step.
std::vector<uint32_t> Descend(const Vocabulary& vocabulary, const Descriptor& descriptor) {
  const Vocabulary::Node* nodes = VocabularyBuilder::Nodes(vocabulary);
  std::vector<uint32_t> path;
  for (uint32_t index = 0; nodes[index].num_children > 0;) {
    std::vector<uint32_t> children(nodes[index].num_children);
    std::iota(children.begin(), children.end(), nodes[index].first_child);
    index = *std::min_element(children.begin(), children.end(), [&](uint32_t a, uint32_t b) {
      return HammingDistance(nodes[a].descriptor, descriptor) < HammingDistance(nodes[b].descriptor, descriptor);
    });
    path.push_back(index);
  }
  return path;
}

TEST(Vocabulary, TransformWeighsWordsByTfIdf) {
  const auto vocabulary = SmallVocabulary();
  const std::vector<Descriptor> image = RandomImages(1, 2)[0];
  const Vocabulary::Node* tree = VocabularyBuilder::Nodes(*vocabulary);
  std::map<uint32_t, double> expected;
  double sum = 0;
  for (const Descriptor& descriptor : image) {
    const Vocabulary::Node& leaf = tree[Descend(*vocabulary, descriptor).back()];
    if (leaf.weight > 0) expected[leaf.word] += leaf.weight;
    sum += leaf.weight;
  }
  BowVector bow;
  NodeFeatures nodes;
  vocabulary->Transform(image, 0, &bow, &nodes);
  ASSERT_EQ(bow.size(), expected.size());
  double bow_sum = 0;
  auto entry = expected.begin();
  for (const auto& [word, weight] : bow) {  // sorted, as the map is
    EXPECT_EQ(word, entry->first);
    EXPECT_NEAR(weight, entry->second / sum, 1e-6);
    bow_sum += weight;
    ++entry;
  }
  EXPECT_NEAR(bow_sum, 1, 1e-5);
}

TEST(Vocabulary, DirectIndexNamesTheNodeAtItsLevel) {
  const auto vocabulary = SmallVocabulary();
  const std::vector<Descriptor> image = RandomImages(1, 3)[0];
  for (int direct_level : {0, 1, 2, 3, 4, 9}) {
    const size_t level = static_cast<size_t>(std::max(1, vocabulary->depth() - direct_level));
    NodeFeatures expected;
    for (uint32_t i = 0; i < image.size(); ++i) {
      const std::vector<uint32_t> path = Descend(*vocabulary, image[i]);
      expected.emplace_back(path[std::min(level, path.size()) - 1], i);
    }
    std::sort(expected.begin(), expected.end());
    BowVector bow;
    NodeFeatures nodes = {{12345, 6}};  // what was there goes
    vocabulary->Transform(image, direct_level, &bow, &nodes);
    EXPECT_EQ(nodes, expected);
    NodeFeatures without_words;
    vocabulary->Transform(image, direct_level, nullptr, &without_words);
    EXPECT_EQ(without_words, expected);
  }
}

/// A root with 256 children of 256 words each: more nodes than a direct index counts.
std::shared_ptr<const Vocabulary> WideVocabulary() {
  constexpr uint32_t kChildren = 256;
  Random random(5);
  std::vector<Vocabulary::Node> nodes(1 + kChildren + kChildren * kChildren);
  for (uint32_t i = 0; i < nodes.size(); ++i) {
    if (i > 0) nodes[i].descriptor = RandomDescriptor(&random);
    if (i <= kChildren) {
      nodes[i].first_child = 1 + i * kChildren;
      nodes[i].num_children = kChildren;
    } else {
      nodes[i].weight = 1;
      nodes[i].word = i - kChildren - 1;
    }
  }
  return VocabularyBuilder::FromNodes(kChildren, 2, std::move(nodes), "test").value();
}

TEST(Vocabulary, DirectIndexOfAWideTreeStopsAtTheLastNodeThatItCounts) {
  const auto vocabulary = WideVocabulary();
  const Vocabulary::Node* tree = VocabularyBuilder::Nodes(*vocabulary);
  const std::vector<Descriptor> image = {tree[1].descriptor, tree[256].descriptor};
  const std::vector<uint32_t> first = Descend(*vocabulary, image[0]), last = Descend(*vocabulary, image[1]);
  ASSERT_LT(first[1], Vocabulary::kMaxDirectNodes);
  ASSERT_GE(last[1], Vocabulary::kMaxDirectNodes);
  NodeFeatures expected = {{first[1], 0}, {last[0], 1}};
  std::sort(expected.begin(), expected.end());
  BowVector bow;
  NodeFeatures nodes;
  vocabulary->Transform(image, 0, &bow, &nodes);
  EXPECT_EQ(nodes, expected);
  EXPECT_EQ(bow.size(), 2u);
}

TEST(Vocabulary, ScoresSimilarImagesHigher) {
  const auto vocabulary = SmallVocabulary();
  const auto images = RandomImages(10, 1);  // the things it was trained on
  Random random(4);
  std::vector<Descriptor> again;
  for (const Descriptor& descriptor : images[0]) again.push_back(WithNoise(descriptor, 0.02, &random));
  BowVector first, second, other;
  NodeFeatures nodes;
  vocabulary->Transform(images[0], 2, &first, &nodes);
  vocabulary->Transform(again, 2, &second, &nodes);
  for (size_t i = 1; i < images.size(); ++i) {
    vocabulary->Transform(images[i], 2, &other, &nodes);
    EXPECT_GT(BowScore(first, second), BowScore(first, other) + 0.2);
  }
}

TEST(Vocabulary, TransformOfNothingIsEmpty) {
  BowVector bow = {{1, 1.0f}};
  NodeFeatures nodes = {{1, 2}};
  SmallVocabulary()->Transform({}, 2, &bow, &nodes);
  EXPECT_TRUE(bow.empty());
  EXPECT_TRUE(nodes.empty());
}

TEST(Vocabulary, DefaultPathIsTheVariableOrBesideTheProgram) {
  ASSERT_EQ(setenv("PORTOLAN_VOCABULARY", "/some/where.pvoc", 1), 0);
  EXPECT_EQ(Vocabulary::DefaultPath(), "/some/where.pvoc");
  ASSERT_EQ(unsetenv("PORTOLAN_VOCABULARY"), 0);
  const std::string path = Vocabulary::DefaultPath();
  const std::string end = "/share/portolan/default.pvoc";
  ASSERT_GT(path.size(), end.size());
  EXPECT_EQ(path.front(), '/');
  EXPECT_EQ(path.substr(path.size() - end.size()), end);
  EXPECT_EQ(path.find(".."), std::string::npos);
}

}  // namespace
}  // namespace portolan
