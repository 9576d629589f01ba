#include "testing/sequence_writer.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "dataset/calibration.h"
#include "dataset/image_source.h"
#include "dataset/trajectory_io.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

class SequenceWriterTest : public testing::TestWithParam<SequenceLayout> {
 protected:
  void SetUp() override {
    std::string name = testing::UnitTest::GetInstance()->current_test_info()->name();
    for (char& c : name) c = c == '/' ? '_' : c;
    folder_ = fs::temp_directory_path() / ("portolan_writer_" + name + "_" + std::to_string(getpid()));
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  static SyntheticSequence MakeShort() {
    SequenceOptions options;
    options.scene = "wall";
    options.width = 160;
    options.height = 120;
    options.texture_px = 256;
    options.num_frames = 5;
    return SyntheticSequence::Make(options).value();
  }
  SequenceWriterOptions Options(SequenceLayout layout) const {
    SequenceWriterOptions options;
    options.folder = folder_.string();
    options.layout = layout;
    options.format = PictureFormat::kPng;
    return options;
  }

  fs::path folder_;
};

std::string TruthFile(SequenceLayout layout) {
  switch (layout) {
    case SequenceLayout::kTum:
      return "groundtruth.txt";
    case SequenceLayout::kKitti:
      return "poses.txt";
    case SequenceLayout::kEuroc:
      return "mav0/state_groundtruth_estimate0/data.csv";
  }
  return "";
}

TEST_P(SequenceWriterTest, IsReadBackByTheSourcesOfItsLayout) {
  const SyntheticSequence sequence = MakeShort();
  ASSERT_TRUE(WriteSequence(sequence, Options(GetParam()), nullptr).ok());
  SourceOptions source_options;
  source_options.data = folder_.string();
  Result<std::unique_ptr<ImageSource>> source = OpenImageSource(source_options);
  ASSERT_TRUE(source.ok()) << source.error().message;
  EXPECT_NEAR((*source)->camera().pinhole.fx, sequence.camera().fx, 1e-6);
  EXPECT_NEAR((*source)->camera().pinhole.cy, sequence.camera().cy, 1e-6);
  SequenceRenderer renderer(sequence);
  for (size_t i = 0; i < sequence.frames().size(); ++i) {
    Result<std::optional<Image>> image = (*source)->Next();
    ASSERT_TRUE(image.ok() && image->has_value()) << i;
    EXPECT_EQ((*image)->stamp, sequence.frames()[i].stamp);
    EXPECT_EQ(cv::norm((*image)->grey, renderer.Render(i), cv::NORM_INF), 0);  // PNG loses nothing
  }
  Result<std::optional<Image>> end = (*source)->Next();
  EXPECT_TRUE(end.ok() && !end->has_value());
}

TEST_P(SequenceWriterTest, GroundTruthIsReadBackExactly) {
  const SyntheticSequence sequence = MakeShort();
  ASSERT_TRUE(WriteSequence(sequence, Options(GetParam()), nullptr).ok());
  const bool kitti = GetParam() == SequenceLayout::kKitti;
  const Result<Trajectory> truth =
      ReadTrajectory((folder_ / TruthFile(GetParam())).string(), kitti ? (folder_ / "times.txt").string() : "");
  ASSERT_TRUE(truth.ok()) << truth.error().message;
  ASSERT_EQ(truth->size(), sequence.frames().size());
  const Rigid3d file_from_world = kitti ? sequence.frames()[0].world_from_camera.Inverse() : Rigid3d();
  for (size_t i = 0; i < truth->size(); ++i) {
    EXPECT_EQ((*truth)[i].stamp, sequence.frames()[i].stamp);
    EXPECT_THAT((*truth)[i].world_from_camera,
                RigidNear(file_from_world * sequence.frames()[i].world_from_camera, PoseTolerance{1e-7, 1e-8}));
  }
}

INSTANTIATE_TEST_SUITE_P(Layouts, SequenceWriterTest,
                         testing::Values(SequenceLayout::kTum, SequenceLayout::kKitti, SequenceLayout::kEuroc));

using SequenceWriterErrors = SequenceWriterTest;

TEST_F(SequenceWriterErrors, RefusesAFolderThatIsNotEmptyUnlessTold) {
  const SyntheticSequence sequence = MakeShort();
  SequenceWriterOptions options = Options(SequenceLayout::kTum);
  fs::create_directories(folder_);
  std::ofstream(folder_ / "precious.txt") << "data";
  const Status refused = WriteSequence(sequence, options, nullptr);
  ASSERT_FALSE(refused.ok());
  EXPECT_NE(refused.error().message.find(folder_.string() + ": is not empty"), std::string::npos);
  options.overwrite = true;
  EXPECT_TRUE(WriteSequence(sequence, options, nullptr).ok());
  EXPECT_TRUE(fs::exists(folder_ / "precious.txt"));
}

TEST_F(SequenceWriterErrors, NamesAFolderThatCantBeMade) {
  std::ofstream(folder_) << "a file in the way";
  SequenceWriterOptions options = Options(SequenceLayout::kTum);
  options.folder = (folder_ / "below").string();
  const Status refused = WriteSequence(MakeShort(), options, nullptr);
  ASSERT_FALSE(refused.ok());
  EXPECT_NE(refused.error().message.find(options.folder), std::string::npos) << refused.error().message;
}

TEST_F(SequenceWriterErrors, StoppedRunLeavesNoListOfPictures) {
  const auto stop_after_two = [](size_t done, size_t) { return done < 2; };
  EXPECT_FALSE(WriteSequence(MakeShort(), Options(SequenceLayout::kTum), stop_after_two).ok());
  EXPECT_FALSE(fs::exists(folder_ / "rgb.txt"));
}

}  // namespace
}  // namespace portolan
