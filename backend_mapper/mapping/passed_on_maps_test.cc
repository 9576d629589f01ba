#include "mapping/passed_on_maps.h"

#include <gtest/gtest.h>

#include "map/random_edits.h"

namespace portolan {
namespace {

class PassedOnMapsTest : public ::testing::Test {
 protected:
  PassedOnMapsTest() {
    for (uint32_t i = 0; i < 3; ++i) {
      maps_.emplace_back(MapId(0, 1, i + 1), 1);
      RandomEdits edits(i, &maps_.back());
      for (int k = 0; k < 5; ++k) edits.Edit(RandomEdits::kAddKeyFrame);
    }
  }
  size_t Returned(size_t i) {
    MapReplica replica(maps_[i].id());
    passed_on_.Return(&replica);
    for (const auto& [id, data] : replica.keyframe_data()) EXPECT_EQ(data, maps_[i].keyframe(id).data) << "no copy";
    return replica.keyframe_data().size();
  }
  std::vector<Map> maps_;
  PassedOnMaps passed_on_;
};

TEST_F(PassedOnMapsTest, TheLastMapsComeBackWithTheirKeyFrames) {
  for (const Map& map : maps_) passed_on_.Keep(map);
  EXPECT_EQ(Returned(0), 0u) << "of three the oldest is gone";
  EXPECT_EQ(Returned(1), maps_[1].keyframes().size());
  EXPECT_EQ(Returned(2), maps_[2].keyframes().size());
  EXPECT_EQ(Returned(2), 0u) << "once";
}

TEST_F(PassedOnMapsTest, AMapKeptAgainIsTheNewest) {
  passed_on_.Keep(maps_[0]);
  passed_on_.Keep(maps_[1]);
  passed_on_.Keep(maps_[0]);
  passed_on_.Keep(maps_[2]);
  EXPECT_GT(Returned(0), 0u);
  EXPECT_EQ(Returned(1), 0u);
}

TEST_F(PassedOnMapsTest, ForgetsADeletedMap) {
  passed_on_.Keep(maps_[0]);
  passed_on_.Forget(maps_[1].id());
  passed_on_.Forget(maps_[0].id());
  EXPECT_EQ(Returned(0), 0u);
}

}  // namespace
}  // namespace portolan
