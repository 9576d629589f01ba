// What comes in the middle of a run: a second mapper, Ctrl-C, a full disk.

#include <sys/mount.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>

#include "processes/process_test.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;

constexpr int kFailure = 1, kRefused = 4, kInterrupted = 130;  // docs/configuration.md

class TroubleTest : public ProcessTest {
 protected:
  std::unique_ptr<ChildProcess> StartSlowRun() {
    return Start(RunCommand({"--data", Sequence(), "--speed", RealTimeSpeed(0.5)}));
  }
  /// Until the mapper has a map and the tracker is well on its way in it.
  void WaitUntilMapping() {
    StatusWatch watch(DdsVendor::kFastDds, domain_);
    ASSERT_TRUE(watch.WaitUntil(
        [](const StatusWatch::Heard& heard) {
          return heard.Figure("backend_mapper", "keyframes_taken") >= 3 && heard.tracker &&
                 heard.tracker->state == TrackingState::kTracking;
        },
        kProcessDeadline))
        << Logs();
  }
};

TEST_F(TroubleTest, SecondMapperIsRefusedAndTheFirstGoesOn) {
  const auto run = StartSlowRun();
  WaitUntilMapping();
  const Ended second = RunToEnd({Program("portolan_backend_mapper"), "--domain", std::to_string(domain_)});
  EXPECT_EQ(second.code, kRefused) << second.output;
  EXPECT_THAT(second.output, HasSubstr("refused"));
  const Ended ended = WaitForEnd(run.get());
  ASSERT_EQ(ended.code, 0) << ended.output << Logs();
  ExpectWholeOutput(Out());
  EXPECT_EQ(Report("summary")["maps"], 1);
  EXPECT_EQ(Report("atlas_server")["takeovers"], 0);
}

TEST_F(TroubleTest, InterruptEndsTheRunAndLeavesWhatWasDone) {
  const auto run = StartSlowRun();
  WaitUntilMapping();
  run->Send(SIGINT);
  const Ended ended = WaitForEnd(run.get());
  EXPECT_EQ(ended.code, kInterrupted) << ended.output;
  ExpectWholeOutput(Out());
  const nlohmann::json summary = Report("summary");
  EXPECT_LT(summary["frames"], NumFrames());
  EXPECT_EQ(summary["exit_codes"],
            (nlohmann::json{
                {"frontend_tracker", kInterrupted}, {"backend_mapper", 0}, {"loop_closer", 0}, {"atlas_server", 0}}));
}

/// A small file system of its own; needs the right to mount.
class SmallDisk {
 public:
  explicit SmallDisk(std::string path) : path_(std::move(path)) {
    std::filesystem::create_directories(path_);
    mounted_ = mount("tmpfs", path_.c_str(), "tmpfs", 0, "size=4m") == 0;
    if (!mounted_) reason_ = std::strerror(errno);
  }
  ~SmallDisk() {
    if (mounted_) umount2(path_.c_str(), MNT_DETACH);
  }
  bool mounted() const { return mounted_; }
  const std::string& reason() const { return reason_; }
  /// Leaves no byte free.
  void Fill() const {
    std::ofstream filler(path_ + "/filler", std::ios::binary);
    const std::string page(4096, 'x');
    while (filler.write(page.data(), static_cast<std::streamsize>(page.size())).flush()) {
    }
  }

 private:
  std::string path_, reason_;
  bool mounted_ = false;
};

TEST_F(TroubleTest, FullDiskIsNamedAndWhatWasThereStays) {
  const SmallDisk disk(Out());
  if (!disk.mounted()) GTEST_SKIP() << "a small file system can't be mounted: " << disk.reason();
  const std::string earlier = "1.0 0 0 0 0 0 0 1\n";
  std::ofstream(Out() + "/trajectory.txt") << earlier;
  const auto run = StartSlowRun();
  WaitUntilMapping();
  disk.Fill();
  const Ended ended = WaitForEnd(run.get());
  EXPECT_EQ(ended.code, kFailure) << ended.output;
  EXPECT_THAT(ended.output, HasSubstr("No space left on device"));
  EXPECT_THAT(ended.output, HasSubstr(Out()));
  EXPECT_TRUE(ReadWholeFile(Out() + "/trajectory.txt") == earlier);
  for (const auto& entry : std::filesystem::directory_iterator(Out())) {
    EXPECT_THAT(entry.path().extension(), AnyOf("", ".txt", ".db", ".db-wal", ".db-shm"))
        << entry.path() << " is left over";
  }
}

}  // namespace
}  // namespace portolan
