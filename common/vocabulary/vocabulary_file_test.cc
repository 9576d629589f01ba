#include "vocabulary/vocabulary_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>

#include "vocabulary/test_descriptors.h"
#include "vocabulary/vocabulary_training.h"

namespace portolan {
namespace {

using testing::HasSubstr;

/// A folder of its own for each test.
class VocabularyFile : public testing::Test {
 protected:
  void SetUp() override {
    const testing::TestInfo* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::path(testing::TempDir()) /
              (std::string("portolan_vocabulary_") + test->name() + std::to_string(getpid()));
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  std::string Write(const std::string& name, const std::string& content) const {
    std::ofstream(Path(name), std::ios::binary) << content;
    return Path(name);
  }
  static std::string Read(const std::string& path) {
    std::ostringstream content;
    content << std::ifstream(path, std::ios::binary).rdbuf();
    return content.str();
  }
  /// The bytes of a small vocabulary's file.
  std::string SmallFile() const {
    EXPECT_TRUE(SaveVocabulary(*SmallVocabulary(), Path("small.pvoc")).ok());
    return Read(Path("small.pvoc"));
  }
  static std::shared_ptr<const Vocabulary> SmallVocabulary() {
    VocabularyTrainingOptions options;
    options.branching = 3;
    options.depth = 2;
    return TrainVocabulary(RandomImages(5, 1), options, nullptr).value();
  }
  /// The message of a file that must not open: it names the file.
  static std::string OpenError(const std::string& path) {
    const auto vocabulary = Vocabulary::Open(path);
    EXPECT_EQ(Vocabulary::HashOf(path).ok(), vocabulary.ok());
    if (vocabulary.ok()) return "opened";
    EXPECT_THAT(vocabulary.error().message, HasSubstr(path));
    return vocabulary.error().message;
  }

  std::filesystem::path folder_;
};

void ExpectSame(const Vocabulary& a, const Vocabulary& b) {
  EXPECT_EQ(a.hash(), b.hash());
  EXPECT_EQ(a.num_nodes(), b.num_nodes());
  EXPECT_EQ(a.num_words(), b.num_words());
  EXPECT_EQ(a.branching(), b.branching());
  EXPECT_EQ(a.depth(), b.depth());
  for (const auto& image : RandomImages(3, 2)) {
    BowVector bow_a, bow_b;
    NodeFeatures nodes_a, nodes_b;
    a.Transform(image, 1, &bow_a, &nodes_a);
    b.Transform(image, 1, &bow_b, &nodes_b);
    EXPECT_EQ(bow_a, bow_b);
    EXPECT_EQ(nodes_a, nodes_b);
  }
}

TEST_F(VocabularyFile, OpensWhatWasSaved) {
  const auto vocabulary = SmallVocabulary();
  ASSERT_TRUE(SaveVocabulary(*vocabulary, Path("a.pvoc")).ok());
  const auto opened = Vocabulary::Open(Path("a.pvoc"));
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  ExpectSame(**opened, *vocabulary);
  EXPECT_EQ(Vocabulary::HashOf(Path("a.pvoc")).value(), vocabulary->hash());
  ASSERT_TRUE(SaveVocabulary(**opened, Path("b.pvoc")).ok());
  EXPECT_EQ(Read(Path("a.pvoc")), Read(Path("b.pvoc")));
}

TEST_F(VocabularyFile, OutlivesItsFile) {
  ASSERT_TRUE(SaveVocabulary(*SmallVocabulary(), Path("a.pvoc")).ok());
  const auto opened = Vocabulary::Open(Path("a.pvoc")).value();
  std::filesystem::remove(Path("a.pvoc"));
  ExpectSame(*opened, *SmallVocabulary());
}

TEST_F(VocabularyFile, RefusesWhatIsNoFile) {
  EXPECT_THAT(OpenError(Path("missing.pvoc")), HasSubstr("No such file"));
  EXPECT_THAT(OpenError(folder_.string()), HasSubstr("not a regular file"));
  EXPECT_THAT(OpenError(Write("empty.pvoc", "")), HasSubstr("empty"));
}

TEST_F(VocabularyFile, RefusesAnotherKindOfFile) {
  EXPECT_THAT(OpenError(Write("text.pvoc", "10 6 0 0\n0 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17\n")),
              HasSubstr("not a Portolan vocabulary"));
  std::string content = SmallFile();
  content[8] = 2;  // version
  EXPECT_THAT(OpenError(Write("newer.pvoc", content)), HasSubstr("version 2"));
}

TEST_F(VocabularyFile, RefusesAFileCutShortAnywhere) {
  const std::string content = SmallFile();
  ASSERT_EQ(OpenError(Write("whole.pvoc", content)), "opened");
  for (size_t size = 0; size < content.size(); size += 7) {
    EXPECT_NE(OpenError(Write("short.pvoc", content.substr(0, size))), "opened") << size;
  }
  EXPECT_THAT(OpenError(Write("short.pvoc", content.substr(0, content.size() - 1))), HasSubstr("cut short"));
  EXPECT_NE(OpenError(Write("long.pvoc", content + "x")), "opened");
}

TEST_F(VocabularyFile, RefusesAFileWithAnyBitFlipped) {
  const std::string content = SmallFile();
  for (size_t byte = 0; byte < content.size(); ++byte) {
    std::string damaged = content;
    damaged[byte] = static_cast<char>(damaged[byte] ^ (1 << (byte % 8)));
    EXPECT_NE(OpenError(Write("damaged.pvoc", damaged)), "opened") << byte;
  }
}

TEST_F(VocabularyFile, RefusesNodesThatAreNoTree) {
  const auto vocabulary = SmallVocabulary();
  const Vocabulary::Node* tree = VocabularyBuilder::Nodes(*vocabulary);
  const std::vector<Vocabulary::Node> good(tree, tree + vocabulary->num_nodes());
  const auto is_refused = [&](const std::function<void(std::vector<Vocabulary::Node>*)>& change) {
    std::vector<Vocabulary::Node> nodes = good;
    change(&nodes);
    const auto result = VocabularyBuilder::FromNodes(3, 2, std::move(nodes), "test");
    return !result.ok() && result.error().message.find("vocabulary test") == 0;
  };
  EXPECT_FALSE(is_refused([](auto*) {}));
  EXPECT_TRUE(is_refused([](auto* nodes) { nodes->clear(); }));
  EXPECT_TRUE(is_refused([](auto* nodes) { nodes->resize(1); }));
  EXPECT_TRUE(is_refused([](auto* nodes) { nodes->pop_back(); }));
  EXPECT_TRUE(is_refused([](auto* nodes) { nodes->push_back(nodes->back()); }));
  EXPECT_TRUE(is_refused([](auto* nodes) { (*nodes)[1].first_child = 0; }));
  EXPECT_TRUE(is_refused([](auto* nodes) { (*nodes)[0].num_children = 4; }));
  EXPECT_TRUE(is_refused([](auto* nodes) { (*nodes)[0].num_children = 0xffffffffu; }));
  EXPECT_TRUE(is_refused([](auto* nodes) { nodes->back().word = 0; }));
  EXPECT_TRUE(is_refused([](auto* nodes) { nodes->back().word = 1000; }));
  EXPECT_TRUE(is_refused([](auto* nodes) { nodes->back().weight = -1; }));
  EXPECT_TRUE(is_refused([](auto* nodes) { nodes->back().weight = NAN; }));
  EXPECT_FALSE(VocabularyBuilder::FromNodes(3, 1, good, "test").ok());
  EXPECT_FALSE(VocabularyBuilder::FromNodes(0, 2, good, "test").ok());
  EXPECT_FALSE(VocabularyBuilder::FromNodes(3, 1000, good, "test").ok());
}

TEST_F(VocabularyFile, SavingSaysWhyItFailsAndLeavesWhatIsThere) {
  const auto status = SaveVocabulary(*SmallVocabulary(), Path("no_such_folder/a.pvoc"));
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(status.error().message, HasSubstr("no_such_folder/a.pvoc"));
  std::filesystem::create_directory(Path("folder.pvoc"));
  EXPECT_FALSE(SaveVocabulary(*SmallVocabulary(), Path("folder.pvoc")).ok());
  EXPECT_TRUE(std::filesystem::is_directory(Path("folder.pvoc")));
}

/// A vocabulary as DBoW2 writes it, nodes in the order of a depth-first walk, as some tools have them.
std::string ToDbow2Text(const Vocabulary& vocabulary) {
  const Vocabulary::Node* nodes = VocabularyBuilder::Nodes(vocabulary);
  std::ostringstream text;
  text.precision(9);
  text << vocabulary.branching() << ' ' << vocabulary.depth() << " 0 0\n";
  int next_number = 1;
  const std::function<void(uint32_t, int)> write_children = [&](uint32_t index, int number) {
    for (uint32_t c = 0; c < nodes[index].num_children; ++c) {
      const Vocabulary::Node& child = nodes[nodes[index].first_child + c];
      const int child_number = next_number++;
      text << number << ' ' << (child.num_children == 0 ? 1 : 0);
      for (int byte = 0; byte < 32; ++byte)
        text << ' ' << (child.descriptor[static_cast<size_t>(byte / 8)] >> (8 * (byte % 8)) & 255);
      text << ' ' << child.weight << '\n';
      write_children(nodes[index].first_child + c, child_number);
    }
  };
  write_children(0, 0);
  return text.str();
}

TEST_F(VocabularyFile, ReadsDbow2Text) {
  const auto vocabulary = SmallVocabulary();
  const auto read = Vocabulary::ReadDbow2Text(Write("voc.txt", ToDbow2Text(*vocabulary) + "\n"));
  ASSERT_TRUE(read.ok()) << read.error().message;
  EXPECT_EQ((*read)->num_nodes(), vocabulary->num_nodes());
  EXPECT_EQ((*read)->num_words(), vocabulary->num_words());
  const Vocabulary::Node* expected = VocabularyBuilder::Nodes(*vocabulary);
  const Vocabulary::Node* nodes = VocabularyBuilder::Nodes(**read);
  for (uint32_t i = 0; i < vocabulary->num_nodes(); ++i) {  // breadth first again
    EXPECT_EQ(nodes[i].descriptor, expected[i].descriptor);
    EXPECT_EQ(nodes[i].first_child, expected[i].first_child);
    EXPECT_EQ(nodes[i].num_children, expected[i].num_children);
    EXPECT_FLOAT_EQ(nodes[i].weight, expected[i].weight);
  }
}

TEST_F(VocabularyFile, Dbow2ErrorsNameTheLine) {
  const std::string text = ToDbow2Text(*SmallVocabulary());
  const auto error = [&](const std::string& content) {
    const auto read = Vocabulary::ReadDbow2Text(Write("voc.txt", content));
    return read.ok() ? "read" : read.error().message;
  };
  EXPECT_EQ(error(text), "read");
  EXPECT_THAT(error(""), HasSubstr("empty"));
  EXPECT_THAT(error("%YAML:1.0\n"), HasSubstr("line 1: expected 'k L scoring weighting'"));
  EXPECT_THAT(error("10 6 5 0\n"), HasSubstr("scoring 5"));
  EXPECT_THAT(error("10 6 0 0\n"), HasSubstr("no tree"));
  EXPECT_THAT(error("3 2 0 0\n0 1 7 8\n"), HasSubstr("line 2"));
  EXPECT_THAT(error(text + "99999 1 " + text), HasSubstr("the parent above its children"));
  const size_t third_line = text.find('\n', text.find('\n') + 1) + 1;
  EXPECT_THAT(error(text.substr(0, third_line + 20) + "\n" + text.substr(third_line)), HasSubstr("line 3"));
  std::string too_large = text;
  too_large.replace(third_line, 4, "1 0 256 ");
  EXPECT_THAT(error(too_large), HasSubstr("line 3"));
  EXPECT_FALSE(Vocabulary::ReadDbow2Text(Path("missing.txt")).ok());
}

}  // namespace
}  // namespace portolan
