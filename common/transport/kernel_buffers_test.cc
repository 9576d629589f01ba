#include "transport/kernel_buffers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class KernelBuffersTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) / ("kernel_buffers_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  void Put(const std::string& name, const std::string& text) { std::ofstream(folder_ / name) << text; }
  std::filesystem::path folder_;
};

TEST_F(KernelBuffersTest, LargeEnoughIsFine) {
  Put("rmem_max", "4194304\n");
  Put("wmem_max", "8388608\n");
  EXPECT_THAT(CheckKernelBuffers(folder_.string()), IsEmpty());
}

TEST_F(KernelBuffersTest, TooSmallNamesTheSysctlAndTheValue) {
  Put("rmem_max", "212992\n");
  Put("wmem_max", "4194304\n");
  EXPECT_THAT(CheckKernelBuffers(folder_.string()),
              ElementsAre(testing::AllOf(HasSubstr("212992"), HasSubstr("sysctl -w net.core.rmem_max=4194304"))));
}

TEST_F(KernelBuffersTest, NothingIsSaidOfWhatCannotBeRead) {
  EXPECT_THAT(CheckKernelBuffers(folder_.string()), IsEmpty());
}

}  // namespace
}  // namespace portolan
