#include "tracking/followed_maps.h"

#include <gmock/gmock.h>

#include "testing/map_builder.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const MapId kOther(0, 1, 500);

class FollowedMapsTest : public ::testing::Test {
 protected:
  FollowedMapsTest() {
    SyntheticSceneOptions options;
    options.num_views = 4;
    scene_ = MakeSyntheticScene(options);
    // Words of a vocabulary are not needed to see who is indexed: any bag will do.
    for (SyntheticView& view : scene_.views) {
      KeyFrameData data = *view.data;
      data.bow.emplace_back(static_cast<uint32_t>(data.id.sequence()), 1.0f);
      view.data = std::make_shared<const KeyFrameData>(std::move(data));
    }
    map_ = BuildMap(scene_, MapBuilderOptions());
    map_.SetEpoch(1);
  }
  void SendData(MapId map) {
    for (const SyntheticView& view : scene_.views) maps_.AddKeyFrameData(map, view.data);
  }
  KeyFrameId Id(size_t view) const { return scene_.views[view].data->id; }

  SyntheticScene scene_;
  Map map_;
  FollowedMaps maps_;
};

TEST_F(FollowedMapsTest, IgnoresWhatItDoesNotFollow) {
  SendData(map_.id());
  maps_.AddDelta(map_.TakeDelta());
  EXPECT_THAT(maps_.Waiting(), IsEmpty());
  EXPECT_EQ(maps_.Find(map_.id()), nullptr);
  EXPECT_EQ(maps_.FindKeyFrameData(Id(0)), nullptr);
}

TEST_F(FollowedMapsTest, FollowsAndIndexesAMap) {
  maps_.Follow(map_.id(), false);
  SendData(map_.id());
  maps_.AddDelta(map_.TakeDelta());
  EXPECT_THAT(maps_.Waiting(), ElementsAre(map_.id()));
  EXPECT_THAT(maps_.ApplyPending(map_.id()), SizeIs(1));
  EXPECT_EQ(HashMap(maps_.map(map_.id())), HashMap(map_));
  EXPECT_EQ(maps_.index(map_.id()).size(), 4u);
  map_.RemoveKeyFrame(Id(3));
  maps_.AddDelta(map_.TakeDelta());
  maps_.ApplyPending(map_.id());
  EXPECT_EQ(maps_.index(map_.id()).size(), 3u);
  EXPECT_EQ(maps_.index(map_.id()).Find(Id(3)), nullptr);
}

TEST_F(FollowedMapsTest, AsksForAMapThatExistedBefore) {
  maps_.Follow(kOther, false);
  EXPECT_THAT(maps_.InNeed(), IsEmpty()) << "a map that begins";
  maps_.Follow(map_.id(), true);
  ASSERT_THAT(maps_.InNeed(), SizeIs(1));
  EXPECT_TRUE(maps_.IsFresh(map_.id()));
  SendData(map_.id());
  static_cast<void>(map_.TakeDelta());
  maps_.AddDelta(map_.Snapshot());
  maps_.ApplyPending(map_.id());
  EXPECT_THAT(maps_.InNeed(), IsEmpty());
  EXPECT_FALSE(maps_.IsFresh(map_.id()));
  maps_.Follow(map_.id(), true);  // again: no effect
  EXPECT_EQ(maps_.map(map_.id()).keyframes().size(), 4u);
}

TEST_F(FollowedMapsTest, AFusedMapsKeyFrameDataIsFoundInTheReplicaItCameWith) {
  maps_.Follow(kOther, false);
  SendData(kOther);
  maps_.Follow(map_.id(), true);
  maps_.AddDelta(map_.TakeDelta());
  EXPECT_THAT(maps_.ApplyPending(map_.id()), SizeIs(1));
  maps_.Drop(kOther);
  EXPECT_FALSE(maps_.Has(kOther));
  EXPECT_NE(maps_.FindKeyFrameData(Id(2)), nullptr) << "the map has it of its own now";
}

}  // namespace
}  // namespace portolan
