#include "features/orb_descriptor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <opencv2/features2d.hpp>

#include "features/test_images.h"

namespace portolan {
namespace {

double AngleBetween(double a_rad, double b_rad) {
  return std::abs(std::remainder(a_rad - b_rad, 2 * M_PI));
}

/// Keypoints that OpenCV finds on one level, with its orientation in degrees.
std::vector<cv::KeyPoint> OpenCvKeypoints(const cv::Mat& image, const cv::Ptr<cv::ORB>& orb) {
  std::vector<cv::KeyPoint> keypoints;
  orb->detect(image, keypoints);
  return keypoints;
}

cv::Ptr<cv::ORB> OneLevelOrb() {
  return cv::ORB::create(500, 1.2f, 1, kOrbBorder);
}

TEST(OrbDescriptor, EqualsOpenCvs) {
  const cv::Mat image = TexturedImage(320, 240, 1);
  const cv::Ptr<cv::ORB> orb = OneLevelOrb();
  std::vector<cv::KeyPoint> keypoints = OpenCvKeypoints(image, orb);
  cv::Mat expected;
  orb->compute(image, keypoints, expected);
  ASSERT_GT(expected.rows, 300);
  cv::Mat smoothed;
  SmoothForOrb(image, &smoothed);
  for (int i = 0; i < expected.rows; ++i) {
    const cv::KeyPoint& keypoint = keypoints[static_cast<size_t>(i)];
    const float angle_rad = keypoint.angle * static_cast<float>(CV_PI / 180.0);
    Descriptor descriptor;
    std::memcpy(&descriptor, expected.ptr(i), sizeof descriptor);
    EXPECT_EQ(OrbDescriptor(smoothed, cvRound(keypoint.pt.x), cvRound(keypoint.pt.y), angle_rad), descriptor) << i;
  }
}

TEST(OrbAngle, EqualsOpenCvs) {
  const cv::Mat image = TexturedImage(320, 240, 2);
  const std::vector<cv::KeyPoint> keypoints = OpenCvKeypoints(image, OneLevelOrb());
  ASSERT_GT(keypoints.size(), 300u);
  for (const cv::KeyPoint& keypoint : keypoints) {
    const float angle_rad = OrbAngle(image, cvRound(keypoint.pt.x), cvRound(keypoint.pt.y));
    EXPECT_GE(angle_rad, 0);
    EXPECT_LT(angle_rad, 2 * M_PI);
    EXPECT_LT(AngleBetween(angle_rad, keypoint.angle * CV_PI / 180), 0.3 * CV_PI / 180);  // accuracy of cv::fastAtan2
  }
}

TEST(OrbAngle, TurnsWithTheImage) {
  const cv::Mat image = TexturedImage(101, 101, 3);  // odd: the centre stays where it is
  const float angle_rad = OrbAngle(image, 50, 50);
  cv::Mat turned;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
  EXPECT_NEAR(AngleBetween(OrbAngle(turned, 50, 50), angle_rad + M_PI / 2), 0, 1e-5);
  cv::rotate(image, turned, cv::ROTATE_180);
  EXPECT_NEAR(AngleBetween(OrbAngle(turned, 50, 50), angle_rad + M_PI), 0, 1e-5);
}

TEST(OrbAngle, PointsToTheBrightSide) {
  cv::Mat image(60, 60, CV_8UC1, cv::Scalar(10));
  image(cv::Rect(30, 0, 30, 60)) = 200;
  EXPECT_NEAR(AngleBetween(OrbAngle(image, 29, 30), 0), 0, 1e-5);
  cv::rotate(image, image, cv::ROTATE_90_CLOCKWISE);  // bright below: y points down
  EXPECT_NEAR(OrbAngle(image, 30, 29), M_PI / 2, 1e-5);
}

TEST(OrbDescriptor, SurvivesRotation) {
  const cv::Mat image = TexturedImage(201, 201, 4);
  const cv::Mat turn = cv::getRotationMatrix2D({100, 100}, 37, 1);
  cv::Mat turned;
  cv::warpAffine(image, turned, turn, image.size(), cv::INTER_LINEAR);
  cv::Mat smoothed, turned_smoothed;
  SmoothForOrb(image, &smoothed);
  SmoothForOrb(turned, &turned_smoothed);
  const Descriptor descriptor = OrbDescriptor(smoothed, 100, 100, OrbAngle(image, 100, 100));
  const Descriptor same = OrbDescriptor(turned_smoothed, 100, 100, OrbAngle(turned, 100, 100));
  const Descriptor unsteered = OrbDescriptor(turned_smoothed, 100, 100, OrbAngle(image, 100, 100));
  EXPECT_LT(HammingDistance(descriptor, same), 40);
  EXPECT_GT(HammingDistance(descriptor, unsteered), 60);
}

}  // namespace
}  // namespace portolan
