// A lens that bends more than its calibration says: the mapper finds it, and the tracker takes it in.

#include <cmath>

#include "geometry/camera_model.h"
#include "processes/process_test.h"

namespace portolan {
namespace {

constexpr RadialResidual kLens{PORTOLAN_TEST_LENS_K1, PORTOLAN_TEST_LENS_K2};
/// Of what the lens bends: a young map of a room tells it to a tenth.
constexpr double kMaxLeftShare = 0.25;
constexpr double kRimRadius = 0.6;  // on the plane z = 1: nearly all features are nearer to the middle

class LensTest : public ProcessTest {};

TEST_F(LensTest, WhatTheCalibrationLeftIsFoundAndTakenIn) {
  const Ended run = RunToEnd(RunCommand({"--data", Sequence("bent_room"), "--speed", "lockstep"}));
  ASSERT_EQ(run.code, 0) << run.output << Logs();
  const nlohmann::json found = Report("summary")["lens_residual"];
  ASSERT_TRUE(found.is_array() && found.size() == 2) << found;
  const RadialResidual residual{found[0].get<double>(), found[1].get<double>()};
  ASSERT_FALSE(residual.IsNone()) << Logs();
  for (const double radius : {kRimRadius / 2, kRimRadius}) {
    const double bend = kLens.Distort({radius, 0}).x() - radius;
    const double found_bend = residual.Distort({radius, 0}).x() - radius;
    EXPECT_LT(std::abs(found_bend - bend), kMaxLeftShare * std::abs(bend)) << "at " << radius << ": found " << found;
  }
}

TEST_F(LensTest, LeftAsItIsWhereSwitchedOff) {
  const Ended run = RunToEnd(
      RunCommand({"--data", Sequence("bent_room"), "--speed", "lockstep", "--set", "mapper.lens.enabled=false"}));
  ASSERT_EQ(run.code, 0) << run.output << Logs();
  EXPECT_EQ(Report("summary")["lens_residual"], nlohmann::json({0, 0}));
}

}  // namespace
}  // namespace portolan
