#include "place_recognition/place_agreement.h"

#include <gtest/gtest.h>

#include "geometry/rigid3.h"

namespace portolan {
namespace {

const Sim3d kTargetFromMap(2, ExpSO3({0.1, 0.2, -0.3}), {1, 2, 3});
const Eigen::Vector3d kCentre(4, -1, 2);
constexpr double kDepth = 3;

bool AgreesWith(const Sim3d& change) {
  return Agree(change * kTargetFromMap, kTargetFromMap, kCentre, kDepth, PlaceAgreementOptions());
}

/// A change around where the camera is in the target, so that it stays there.
Sim3d AroundCamera(double scale, const Eigen::Vector3d& turn) {
  const Eigen::Vector3d centre = kTargetFromMap * kCentre;
  const Eigen::Quaterniond rotation = ExpSO3(turn);
  return Sim3d(scale, rotation, centre - scale * (rotation * centre));
}

TEST(PlaceAgreementTest, ScaleRotationAndPlaceEachHaveTheirBound) {
  EXPECT_TRUE(AgreesWith(Sim3d()));
  EXPECT_TRUE(AgreesWith(AroundCamera(1.19, Eigen::Vector3d::Zero())));
  EXPECT_FALSE(AgreesWith(AroundCamera(1.21, Eigen::Vector3d::Zero())));
  EXPECT_FALSE(AgreesWith(AroundCamera(1 / 1.21, Eigen::Vector3d::Zero())));
  EXPECT_TRUE(AgreesWith(AroundCamera(1, {0, 7.9 * M_PI / 180, 0})));
  EXPECT_FALSE(AgreesWith(AroundCamera(1, {0, 8.1 * M_PI / 180, 0})));
  EXPECT_TRUE(AgreesWith(Sim3d(1, Eigen::Quaterniond::Identity(), {1.19, 0, 0})))
      << "0.2 depths of 3, twice as long in the target";
  EXPECT_FALSE(AgreesWith(Sim3d(1, Eigen::Quaterniond::Identity(), {1.21, 0, 0})));
}

}  // namespace
}  // namespace portolan
