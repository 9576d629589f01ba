#include "process/process_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

TEST(ProcessReport, SummarizesTimesByMedianAndNinetyFifthPercentile) {
  std::vector<double> times;
  for (int i = 0; i <= 100; ++i) times.push_back(i);
  const nlohmann::json summary = SummarizeTimes(times);
  EXPECT_DOUBLE_EQ(summary["median"], 50);
  EXPECT_DOUBLE_EQ(summary["p95"], 95);
  EXPECT_EQ(summary["count"], 101);
}

TEST(ProcessReport, ResourcesAreThoseOfThisProcess) {
  const ResourceUse before = MeasureResources();
  EXPECT_GT(before.resident_bytes, 1e6);
  EXPECT_LE(before.resident_bytes, before.peak_memory_mb * 1e6 + 1e6);  // the kernel counts the two at different times
  EXPECT_GE(before.open_files, 3);
  const std::ifstream one("/proc/self/stat"), another("/proc/self/stat");
  EXPECT_EQ(MeasureResources().open_files, before.open_files + 2);
}

TEST(ProcessReport, SummaryOfNothingIsZero) {
  const nlohmann::json summary = SummarizeTimes({});
  EXPECT_DOUBLE_EQ(summary["median"], 0);
  EXPECT_EQ(summary["count"], 0);
}

TEST(ProcessReport, ResourcesGrowWithUse) {
  const ResourceUse before = MeasureResources();
  volatile double sum = 0;
  while (MeasureResources().cpu_s < before.cpu_s + 0.02) sum = sum + 1;
  EXPECT_GT(before.peak_memory_mb, 1);
  EXPECT_GE(MeasureResources().peak_memory_mb, before.peak_memory_mb);
}

TEST(ProcessReport, IsWrittenWhole) {
  const TempFolder folder;
  ProcessOptions options;
  options.role = "loop_closer";
  options.out = folder.path();
  ASSERT_TRUE(WriteReport(options, {{"role", "loop_closer"}}));
  std::ifstream file(folder.path() + "/loop_closer.json");
  EXPECT_EQ(nlohmann::json::parse(file)["role"], "loop_closer");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), std::filesystem::directory_iterator()),
            1);
}

TEST(ProcessReport, NamesTheFileThatCannotBeWritten) {
  ProcessOptions options;
  options.role = "loop_closer";
  options.out = "/proc/no/such/folder";
  const Status written = WriteReport(options, nlohmann::json::object());
  ASSERT_FALSE(written);
  EXPECT_THAT(written.error().message, HasSubstr("/proc/no/such/folder/loop_closer.json"));
}

}  // namespace
}  // namespace portolan
