#include "features/feature_quantization.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/check.h"
#include "base/random.h"

namespace portolan {
namespace {

PinholeCamera CameraOfSize(int width, int height) {
  return PinholeCamera{500, 500, width / 2.0, height / 2.0, width, height};
}

TEST(FeatureQuantizationTest, StepsAreTheFinestThatFit) {
  EXPECT_EQ(StepsPerPixel(CameraOfSize(640, 480)), 32);
  EXPECT_EQ(StepsPerPixel(CameraOfSize(2048, 100)), 32);  // 2047 * 32 = 65504
  EXPECT_EQ(StepsPerPixel(CameraOfSize(2049, 100)), 16);
  EXPECT_EQ(StepsPerPixel(CameraOfSize(100, 4096)), 16);
  EXPECT_EQ(StepsPerPixel(CameraOfSize(16384, 16384)), 4);
}

TEST(FeatureQuantizationTest, PixelsKeepToHalfAStepAndInsideTheImage) {
  Random random(1);
  for (const int width : {640, 1241, 4096, 16384}) {
    const int steps = StepsPerPixel(CameraOfSize(width, 480));
    for (int i = 0; i < 1000; ++i) {
      const auto x_px = static_cast<float>(random.Uniform(0, width - 1));
      const float rounded_px = StepsToPixel(PixelToSteps(x_px, steps), steps);
      EXPECT_LE(std::abs(rounded_px - x_px), 0.5 / steps);
      EXPECT_LE(rounded_px, static_cast<float>(width - 1));
    }
    EXPECT_EQ(StepsToPixel(PixelToSteps(static_cast<float>(width - 1), steps), steps), static_cast<float>(width - 1));
  }
}

TEST(FeatureQuantizationTest, EveryStepComesBack) {
  for (uint32_t steps = 0; steps <= 65535; ++steps) {
    const auto step = static_cast<uint16_t>(steps);
    ASSERT_EQ(AngleToSteps(StepsToAngle(step)), step);
    ASSERT_EQ(PixelToSteps(StepsToPixel(step, 32), 32), step);
  }
}

TEST(FeatureQuantizationTest, AnglesAreTakenModuloATurn) {
  constexpr double kHalfStep = M_PI / 65536.0;
  EXPECT_EQ(AngleToSteps(static_cast<float>(2 * M_PI)), 0);
  EXPECT_EQ(AngleToSteps(static_cast<float>(-M_PI / 2)), 49152);
  Random random(2);
  for (int i = 0; i < 1000; ++i) {
    const auto angle_rad = static_cast<float>(random.Uniform(-10, 10));
    const double difference = StepsToAngle(AngleToSteps(angle_rad)) - static_cast<double>(angle_rad);
    EXPECT_LE(std::abs(std::remainder(difference, 2 * M_PI)), kHalfStep + 1e-6);  // a float of 10 rad has steps of 1e-6
  }
}

TEST(FeatureQuantizationTest, QuantisingIsIdempotent) {
  Random random(3);
  const PinholeCamera camera = CameraOfSize(640, 480);
  FeatureSet features;
  for (int i = 0; i < 2000; ++i) {
    features.pixels_px.emplace_back(static_cast<float>(random.Uniform(0, 639)),
                                    static_cast<float>(random.Uniform(0, 479)));
    features.angles_rad.push_back(static_cast<float>(random.Uniform(0, 2 * M_PI)));
  }
  QuantizeFeatures(&features, camera);
  FeatureSet again = features;
  QuantizeFeatures(&again, camera);
  EXPECT_TRUE(again.pixels_px == features.pixels_px);
  EXPECT_EQ(again.angles_rad, features.angles_rad);
}

TEST(FeatureQuantizationTest, WhatDoesNotFitIsABug) {
  EXPECT_THROW(PixelToSteps(-0.1f, 32), CheckFailure);
  EXPECT_THROW(PixelToSteps(2048.0f, 32), CheckFailure);
  EXPECT_THROW(PixelToSteps(NAN, 32), CheckFailure);
  EXPECT_THROW(AngleToSteps(NAN), CheckFailure);
}

}  // namespace
}  // namespace portolan
