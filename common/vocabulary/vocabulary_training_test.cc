#include "vocabulary/vocabulary_training.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "vocabulary/test_descriptors.h"
#include "vocabulary/vocabulary_file.h"

namespace portolan {
namespace {

using testing::HasSubstr;

VocabularyTrainingOptions SmallOptions() {
  VocabularyTrainingOptions options;
  options.branching = 5;
  options.depth = 3;
  return options;
}

std::shared_ptr<const Vocabulary> Train(const std::vector<std::vector<Descriptor>>& images,
                                        const VocabularyTrainingOptions& options) {
  return TrainVocabulary(images, options, nullptr).value();
}

TEST(TrainVocabulary, IsDeterministicForASeed) {
  const auto images = RandomImages(20, 1);
  VocabularyTrainingOptions options = SmallOptions();
  const uint64_t hash = Train(images, options)->hash();
  EXPECT_EQ(Train(images, options)->hash(), hash);
  options.seed = 2;
  EXPECT_NE(Train(images, options)->hash(), hash);
}

TEST(TrainVocabulary, MakesATreeOfTheSizeAskedFor) {
  const auto vocabulary = Train(RandomImages(20, 2), SmallOptions());
  EXPECT_EQ(vocabulary->branching(), 5);
  EXPECT_EQ(vocabulary->depth(), 3);
  EXPECT_LE(vocabulary->num_words(), 125u);
  EXPECT_GE(vocabulary->num_words(), 100u);
  EXPECT_LE(vocabulary->num_nodes(), 1u + 5 + 25 + 125);
  EXPECT_GT(vocabulary->num_nodes(), vocabulary->num_words());
}

TEST(TrainVocabulary, WeightsWordsByInverseDocumentFrequency) {
  const auto images = RandomImages(12, 3);
  const auto vocabulary = Train(images, SmallOptions());
  // How many images show a word, by words: leaves at direct level 0.
  std::map<uint32_t, int> images_with;
  for (const auto& image : images) {
    BowVector bow;
    NodeFeatures nodes;
    vocabulary->Transform(image, 0, &bow, &nodes);
    std::set<uint32_t> shown;
    for (const auto& [node, feature] : nodes) shown.insert(node);
    for (const uint32_t node : shown) ++images_with[node];
  }
  const Vocabulary::Node* nodes = VocabularyBuilder::Nodes(*vocabulary);
  for (uint32_t i = 0; i < vocabulary->num_nodes(); ++i) {
    if (nodes[i].num_children > 0) {
      EXPECT_EQ(nodes[i].weight, 0);
    } else {
      const int count = std::max(1, images_with[i]);
      EXPECT_FLOAT_EQ(nodes[i].weight, static_cast<float>(std::log(12.0 / count)));
    }
  }
}

TEST(TrainVocabulary, GivesOneThingOneWord) {
  Random random(4);
  std::vector<Descriptor> things;
  for (int i = 0; i < 20; ++i) things.push_back(RandomDescriptor(&random));
  std::vector<std::vector<Descriptor>> images(30);
  for (size_t i = 0; i < images.size(); ++i) {
    for (size_t t = i % 2; t < things.size(); t += 2) images[i].push_back(things[t]);
  }
  const auto vocabulary = Train(images, SmallOptions());
  EXPECT_EQ(vocabulary->num_words(), 20u);  // as many as there are things, though there is room for 125
  BowVector bow;
  NodeFeatures nodes;
  vocabulary->Transform(things, 0, &bow, &nodes);
  EXPECT_EQ(bow.size(), 20u);
}

TEST(TrainVocabulary, ReportsRisingProgressUpToTheEnd) {
  std::vector<double> shares;
  ASSERT_TRUE(
      TrainVocabulary(RandomImages(10, 5), SmallOptions(), [&](double share) { shares.push_back(share); }).ok());
  ASSERT_FALSE(shares.empty());
  EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
  EXPECT_NEAR(shares.back(), 1, 1e-9);
}

TEST(TrainVocabulary, RefusesTooLittleToTrainFrom) {
  EXPECT_FALSE(TrainVocabulary({}, SmallOptions(), nullptr).ok());
  EXPECT_FALSE(TrainVocabulary({{}, {}}, SmallOptions(), nullptr).ok());
  const auto one_descriptor = TrainVocabulary({std::vector<Descriptor>(50)}, SmallOptions(), nullptr);
  ASSERT_FALSE(one_descriptor.ok());  // fifty times the same: no two words
}

TEST(TrainVocabulary, RefusesOptionsOutOfRange) {
  const auto images = RandomImages(3, 6);
  VocabularyTrainingOptions options;
  options.branching = 1;
  EXPECT_THAT(TrainVocabulary(images, options, nullptr).error().message, HasSubstr("branching"));
  options = {};
  options.depth = 0;
  EXPECT_THAT(TrainVocabulary(images, options, nullptr).error().message, HasSubstr("depth"));
  options = {};
  options.max_iterations = 0;
  EXPECT_THAT(TrainVocabulary(images, options, nullptr).error().message, HasSubstr("max_iterations"));
}

}  // namespace
}  // namespace portolan
