#include "base/atomic_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "base/flat_yaml.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class AtomicFileTest : public testing::Test {
 protected:
  AtomicFileTest() {
    std::string pattern = (fs::temp_directory_path() / "portolan_atomic_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  ~AtomicFileTest() override { fs::remove_all(folder_); }

  size_t NumFiles() const {
    return static_cast<size_t>(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  std::string folder_;
};

TEST_F(AtomicFileTest, WritesAndReplaces) {
  const std::string path = folder_ + "/x.txt";
  ASSERT_TRUE(WriteFileAtomically(path, "first"));
  EXPECT_EQ(*ReadTextFile(path), "first");
  ASSERT_TRUE(WriteFileAtomically(path, std::string("se\0cond", 7)));
  EXPECT_EQ(*ReadTextFile(path), std::string("se\0cond", 7));
  EXPECT_EQ(NumFiles(), 1u) << "no temporary file stays behind";
}

TEST_F(AtomicFileTest, FailsInAFolderThatIsNotThere) {
  const std::string path = folder_ + "/none/x.txt";
  EXPECT_EQ(WriteFileAtomically(path, "x").error().message, path + ": can't be written: No such file or directory");
}

TEST_F(AtomicFileTest, DoesNotReplaceFoldersAndDevices) {
  EXPECT_THAT(WriteFileAtomically(folder_, "x").error().message, HasSubstr("not a regular file"));
  EXPECT_THAT(WriteFileAtomically("/dev/null", "x").error().message, HasSubstr("not a regular file"));
}

/// A limit on the size of files stands in for a full disk: write() comes short and then fails.
TEST_F(AtomicFileTest, KeepsTheOldFileWhenTheDiskIsFull) {
  const std::string path = folder_ + "/x.txt";
  ASSERT_TRUE(WriteFileAtomically(path, "old"));
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{4096, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const Status written = WriteFileAtomically(path, std::string(10000, 'x'));
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  ASSERT_FALSE(written);
  EXPECT_THAT(written.error().message, HasSubstr(path + ": can't be written: "));
  EXPECT_EQ(*ReadTextFile(path), "old");
  EXPECT_EQ(NumFiles(), 1u);
}

}  // namespace
}  // namespace portolan
