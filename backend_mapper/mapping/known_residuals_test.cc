#include "mapping/known_residuals.h"

#include <gtest/gtest.h>

#include "geometry/rigid3.h"

namespace portolan {
namespace {

const PinholeCamera kCamera{500, 500, 320, 240, 640, 480}, kOtherCamera{400, 400, 320, 240, 640, 480};
const RadialResidual kLens{0.01, 0}, kBetter{0.012, -0.001};

class KnownResidualsTest : public ::testing::Test {
 protected:
  void Add(const PinholeCamera& camera, const RadialResidual& residual) {
    KeyFrameData data;
    data.id = KeyFrameId(0, 1, ++last_);
    data.camera = camera;
    data.residual = residual;
    const KeyFrameId parent = last_ > 1 ? KeyFrameId(0, 1, last_ - 1) : KeyFrameId();
    map_.AddKeyFrame(MakeKeyFrameData(data, nullptr), Rigid3d(), parent);
  }
  uint32_t last_ = 0;
  Map map_{MapId(0, 1, 1)};
  KnownResiduals known_;
};

TEST_F(KnownResidualsTest, FindsWhatAMapLacks) {
  known_.Set({kCamera, kLens});
  EXPECT_FALSE(known_.FindLacking(map_)) << "it is empty";
  Add(kCamera, kLens);
  Add(kOtherCamera, {});
  EXPECT_FALSE(known_.FindLacking(map_)) << "another camera's residual is not known";
  Add(kCamera, {});
  EXPECT_EQ(known_.FindLacking(map_), (CameraResidual{kCamera, kLens}));
  map_.SetResidual(kCamera, kLens);
  EXPECT_FALSE(known_.FindLacking(map_));
}

TEST_F(KnownResidualsTest, TheNewestEstimateIsTaken) {
  Add(kCamera, kLens);
  known_.Set({kCamera, kLens});
  known_.Set({kCamera, kBetter});
  known_.Set({kCamera, {}});
  EXPECT_EQ(known_.FindLacking(map_), (CameraResidual{kCamera, kBetter}));
}

TEST_F(KnownResidualsTest, LearnsFromAMapWhatItDoesNotKnow) {
  Add(kCamera, kLens);
  Add(kCamera, kBetter);
  Add(kOtherCamera, kLens);
  known_.Set({kOtherCamera, kBetter});
  known_.Learn(map_);
  EXPECT_EQ(known_.FindLacking(map_), (CameraResidual{kCamera, kBetter})) << "of the youngest";
  map_.SetResidual(kCamera, kBetter);
  EXPECT_EQ(known_.FindLacking(map_), (CameraResidual{kOtherCamera, kBetter})) << "what is known already stays";
}

}  // namespace
}  // namespace portolan
