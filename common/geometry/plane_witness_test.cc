#include "geometry/plane_witness.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "geometry/geometry_test_utils.h"
#include "geometry/two_view.h"

namespace portolan {
namespace {

const PinholeCamera kCamera{500, 500, 320, 240, 640, 480};
const Eigen::Vector3d kNormal = Eigen::Vector3d(0.1, -0.2, 1).normalized();

/// The two motions of a plane in view at distance 3, the camera having gone to `centre`; the true one is first.
std::vector<PlanarMotion> MotionsTo(const Eigen::Vector3d& centre) {
  const Rigid3d motion(ExpSO3({0.02, 0.05 * centre.x(), 0.01}), -(ExpSO3({0.02, 0.05 * centre.x(), 0.01}) * centre));
  const Eigen::Matrix3d euclidean = motion.rotation.toRotationMatrix() + motion.translation * kNormal.transpose() / 3;
  std::vector<PlanarMotion> visible;
  for (const PlanarMotion& m : DecomposeHomography(kCamera.K() * euclidean * kCamera.K().inverse(), kCamera))
    if (m.normal_in_first.z() > 0) visible.push_back(m);
  std::sort(visible.begin(), visible.end(), [](const PlanarMotion& a, const PlanarMotion& b) {
    return a.normal_in_first.dot(kNormal) > b.normal_in_first.dot(kNormal);
  });
  return visible;
}

TEST(PlaneWitnessTest, TheNormalThatStaysIsTheTrueOne) {
  PlaneWitness witness;
  for (const Eigen::Vector3d& centre : {Eigen::Vector3d(0.1, 0.05, 0.3), Eigen::Vector3d(0.2, 0.05, 0.4)}) {
    ASSERT_EQ(MotionsTo(centre).size(), 2u);
    EXPECT_FALSE(witness.Judge(MotionsTo(centre))) << "nothing to compare with";
    witness.Add(MotionsTo(centre));
  }
  std::vector<PlanarMotion> motions = MotionsTo({0.5, 0.1, 0.4});
  EXPECT_GT(motions[0].normal_in_first.dot(kNormal), 0.9999);
  EXPECT_EQ(witness.Judge(motions), 0u);
  std::swap(motions[0], motions[1]);
  EXPECT_EQ(witness.Judge(motions), 1u);
  witness.Clear();
  EXPECT_FALSE(witness.Judge(motions));
}

/// Straight on, both normals stay.
TEST(PlaneWitnessTest, OneDirectionTellsNothing) {
  PlaneWitness witness;
  for (const double way : {0.2, 0.3, 0.4, 0.5}) {
    EXPECT_FALSE(witness.Judge(MotionsTo(way * Eigen::Vector3d(0.4, 0.1, 0.9))));
    witness.Add(MotionsTo(way * Eigen::Vector3d(0.4, 0.1, 0.9)));
  }
}

/// Other planes than before: no motion is believed.
TEST(PlaneWitnessTest, NormalsThatWereNotSeenBeforeAreNotBelieved) {
  PlaneWitness witness;
  for (const Eigen::Vector3d& normal : {Eigen::Vector3d(1, 0, 1), Eigen::Vector3d(-1, 0, 1)})
    witness.Add({{Rigid3d(), normal.normalized()}, {Rigid3d(), normal.normalized()}});
  EXPECT_FALSE(witness.Judge(MotionsTo({0.5, 0.1, 0.4})));
}

}  // namespace
}  // namespace portolan
