// Bad images in the middle of a sequence: counted, named and passed over.

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "processes/process_test.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

class BadImageTest : public ProcessTest {};

TEST_F(BadImageTest, RunGoesOnWithoutTheUnreadableOnes) {
  const std::string data = CopyOfSequence();
  std::vector<std::filesystem::path> images;
  for (const auto& entry : std::filesystem::directory_iterator(data + "/rgb")) images.push_back(entry.path());
  std::sort(images.begin(), images.end());
  ASSERT_EQ(images.size(), NumFrames());
  const auto cut = [](const std::filesystem::path& path) {
    std::filesystem::resize_file(path, std::filesystem::file_size(path) / 2);
  };
  const auto write_png = [](const std::filesystem::path& path, const cv::Mat& image) {
    std::vector<uchar> png;
    ASSERT_TRUE(cv::imencode(".png", image, png));
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(png.data()), static_cast<std::streamsize>(png.size()));
  };
  const cv::Mat image = cv::imread(images[70].string(), cv::IMREAD_GRAYSCALE);
  cut(images[60]);                                         // JPEG
  write_png(images[70], image), cut(images[70]);           // PNG
  write_png(images[80], image(cv::Rect(0, 0, 160, 120)));  // another size
  std::filesystem::resize_file(images[90], 0);             // empty
  std::filesystem::remove(images[100]);                    // missing

  const Ended run = RunToEnd(RunCommand({"--data", data, "--speed", "lockstep"}));
  ASSERT_EQ(run.code, 0) << run.output << Logs();
  ExpectWholeOutput(Out());
  EXPECT_EQ(Report("summary")["frames"], NumFrames());
  EXPECT_EQ(Report("frontend_tracker")["unreadable"], 5);
  EXPECT_EQ(Report("frontend_tracker")["frame_ms"]["count"], NumFrames() - 5);
  const std::string log = ReadWholeFile(Out() + "/logs/frontend_tracker.log");
  for (const size_t i : {60, 70, 80, 90, 100}) EXPECT_THAT(log, HasSubstr(images[i].filename().string()));
}

}  // namespace
}  // namespace portolan
