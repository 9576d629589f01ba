#include "dataset/image_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

/// A picture with detail everywhere, so that a cut-off file lacks some of it.
cv::Mat Checkers() {
  cv::Mat picture(120, 160, CV_8UC1);
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x)
      picture.at<uchar>(y, x) = static_cast<uchar>(((x / 5 + y / 3) % 2) * 200 + x % 50);
  }
  return picture;
}

class ImageFileTest : public testing::TestWithParam<const char*> {
 protected:
  const TempFolder folder_;
};

TEST_P(ImageFileTest, ReadsGrey) {
  const cv::Mat picture = Checkers();
  const std::string path = folder_.Path(std::string("x") + GetParam());
  ASSERT_TRUE(cv::imwrite(path, picture));
  const Result<cv::Mat> read = ReadGreyImage(path);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->type(), CV_8UC1);
  ASSERT_EQ(read->size(), picture.size());
  EXPECT_LT(cv::norm(*read, picture, cv::NORM_L1) / static_cast<double>(picture.total()), 6)
      << "mean error in grey values, of JPEG";
}

TEST_P(ImageFileTest, ConvertsColour) {
  const std::string path = folder_.Path(std::string("x") + GetParam());
  ASSERT_TRUE(cv::imwrite(path, cv::Mat(20, 30, CV_8UC3, cv::Scalar(0, 0, 255))));
  const Result<cv::Mat> read = ReadGreyImage(path);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->type(), CV_8UC1);
  EXPECT_NEAR(read->at<uchar>(10, 10), 76, 2) << "0.299 of 255: red's share of the luminance";
}

TEST_P(ImageFileTest, RefusesAFileThatIsCutShortAnywhere) {
  const std::string name = std::string("x") + GetParam();
  for (const double share : {0.2, 0.5, 0.9, 0.999}) {
    ASSERT_TRUE(cv::imwrite(folder_.Path(name), Checkers()));
    folder_.CutShort(name, share);
    const Result<cv::Mat> read = ReadGreyImage(folder_.Path(name));
    ASSERT_FALSE(read) << share;
    EXPECT_EQ(read.error().message, folder_.Path(name) + ": the image file is cut short (its end marker is missing)");
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, ImageFileTest, testing::Values(".jpg", ".png"));

TEST_F(ImageFileTest, RefusesWhatIsNoImage) {
  EXPECT_THAT(ReadGreyImage(folder_.Path("none.png")).error().message, HasSubstr("none.png: can't be opened"));
  EXPECT_THAT(ReadGreyImage(folder_.Write("empty.png", "")).error().message,
              HasSubstr("empty.png: the image file is empty"));
  EXPECT_THAT(ReadGreyImage(folder_.Write("text.png", "hello")).error().message,
              HasSubstr("text.png: is not an image"));
  EXPECT_THAT(ReadGreyImage(folder_.Write("broken.jpg", "\xff\xd8\xff garbage \xff\xd9")).error().message,
              HasSubstr("broken.jpg: "));
}

TEST_F(ImageFileTest, TellsImagesByTheirNames) {
  for (const char* name : {"a.jpg", "a.JPG", "b/c.jpeg", "x.png", "0.100000.png", "y.pgm"})
    EXPECT_TRUE(HasImageExtension(name)) << name;
  for (const char* name : {"a.txt", "jpg", "a.jpg.txt", "0.1", ""}) EXPECT_FALSE(HasImageExtension(name)) << name;
}

TEST_F(ImageFileTest, ListsImagesWithNumbersByValue) {
  for (const char* name : {"f10.png", "f2.png", "f1.png", "e30.png", "f002b.png", "notes.txt"})
    folder_.Write(name, "x");
  EXPECT_THAT(ListImageFiles(folder_.path()),
              ElementsAre(folder_.Path("e30.png"), folder_.Path("f1.png"), folder_.Path("f2.png"),
                          folder_.Path("f002b.png"), folder_.Path("f10.png")));
  EXPECT_TRUE(ListImageFiles("/nowhere").empty());
}

}  // namespace
}  // namespace portolan
