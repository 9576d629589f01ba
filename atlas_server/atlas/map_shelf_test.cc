#include "atlas/map_shelf.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "atlas/two_maps_test_scene.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;

class MapShelfTest : public ::testing::Test {
 protected:
  MapShelf MakeShelf() {
    return MapShelf(options_, maps_.passes.vocabulary, [this](KeyFrameId id) -> Result<KeyFrameData> {
      loaded_.push_back(id);
      const auto found = file_.find(id);
      if (found == file_.end()) return Error{"damaged"};
      return found->second;
    });
  }
  /// As it is sent: without what is derived.
  static KeyFrameData Sent(const KeyFrame& keyframe) {
    KeyFrameData data = *keyframe.data;
    data.grid = FeatureGrid();
    data.bow.clear();
    data.nodes.clear();
    return data;
  }
  void Follow(const Map& map, MapShelf* shelf) {
    for (const auto& [id, keyframe] : map.keyframes()) shelf->AddKeyFrame(map.id(), Sent(keyframe));
    shelf->replicas().AddDelta(map.Snapshot());
    ASSERT_EQ(shelf->ApplyPending().size(), 1u);
  }
  void Store(const Map& map, MapShelf* shelf) {
    for (const auto& [id, keyframe] : map.keyframes()) {
      file_[id] = Sent(keyframe);
      shelf->OnStored(id);
    }
  }
  static size_t WithAppearance(const Map& map) {
    return static_cast<size_t>(std::count_if(map.keyframes().begin(), map.keyframes().end(), [](const auto& entry) {
      return entry.second.data->features.HasAppearance();
    }));
  }

  const TwoMaps maps_;
  ShelfOptions options_;
  std::map<KeyFrameId, KeyFrameData> file_;
  std::vector<KeyFrameId> loaded_;
};

TEST_F(MapShelfTest, IndexesTheWordsOfEachMap) {
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  Follow(maps_.second, &shelf);
  EXPECT_EQ(shelf.indexed_keyframes(), 40u);
  const auto others = shelf.Others({maps_.second.id(), MapId(9, 9, 9), maps_.first.id()});
  ASSERT_EQ(others.size(), 2u);
  EXPECT_EQ(others[0].id, maps_.second.id());
  EXPECT_EQ(others[1].num_keyframes(), 20u);
  for (const auto& [id, keyframe] : maps_.first.keyframes()) EXPECT_EQ(*shelf.FindWords(id), keyframe.data->bow) << id;
}

TEST_F(MapShelfTest, TakesAStoredMapInWhole) {
  options_.newest = 0;
  StoredMap stored;
  stored.snapshot = maps_.first.Snapshot();
  for (const auto& [id, keyframe] : maps_.first.keyframes()) stored.keyframes.push_back(Sent(keyframe));
  for (const bool is_stored : {false, true}) {
    MapShelf shelf = MakeShelf();
    int noted = 0;
    shelf.TakeIn(stored, is_stored, [&] { ++noted; });
    EXPECT_GE(noted, 20);
    EXPECT_EQ(shelf.FindMap(maps_.first.id()), nullptr) << "its state waits";
    shelf.ApplyPending();
    ASSERT_NE(shelf.FindMap(maps_.first.id()), nullptr);
    EXPECT_EQ(HashMap(*shelf.FindMap(maps_.first.id())), HashMap(maps_.first));
    EXPECT_EQ(shelf.indexed_keyframes(), 20u);
    shelf.Trim();
    EXPECT_EQ(WithAppearance(*shelf.FindMap(maps_.first.id())), is_stored ? 0u : 20u);
  }
}

TEST_F(MapShelfTest, OfOneMapTheNewestKeyFramesKeepTheirDescriptors) {
  options_.newest = 6;
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  shelf.Trim();
  EXPECT_EQ(WithAppearance(*shelf.FindMap(maps_.first.id())), 20u) << "nothing is stored yet";
  Store(maps_.first, &shelf);
  shelf.Trim();
  const Map& map = *shelf.FindMap(maps_.first.id());
  EXPECT_EQ(WithAppearance(map), 6u);
  EXPECT_TRUE(map.keyframes().rbegin()->second.data->features.HasAppearance());
  EXPECT_EQ(shelf.num_appearances(), 6u);
  EXPECT_EQ(shelf.indexed_keyframes(), 20u) << "words stay";
}

TEST_F(MapShelfTest, OfSeveralMapsThoseLookedAtLastUpToTheBudget) {
  MapShelf unbounded = MakeShelf();
  Follow(maps_.first, &unbounded);
  Follow(maps_.second, &unbounded);
  options_.memory_mb = unbounded.appearance_mb() / 4;
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  Follow(maps_.second, &shelf);
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  const Map& map = *shelf.FindMap(maps_.first.id());
  const std::vector<KeyFrameId> looked_at{maps_.passes.first.views[2].data->id, maps_.passes.first.views[3].data->id};
  shelf.BeginEvent();
  EXPECT_TRUE(shelf.EnsureAppearance(map, looked_at));
  shelf.Trim();
  EXPECT_LE(shelf.appearance_mb(), options_.memory_mb);
  EXPECT_GT(shelf.num_appearances(), 5u);
  EXPECT_EQ(WithAppearance(map), 2u) << "of the first map, which is older, those that were looked at";
  EXPECT_TRUE(map.keyframe(looked_at[0]).data->features.HasAppearance());
}

TEST_F(MapShelfTest, ReadsDescriptorsBackOnDemandInBoundedPieces) {
  options_.newest = 0;
  options_.loads_an_event = 4;
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  Store(maps_.first, &shelf);
  shelf.Trim();
  const Map& map = *shelf.FindMap(maps_.first.id());
  ASSERT_EQ(WithAppearance(map), 0u);
  std::vector<KeyFrameId> wanted;
  for (size_t i = 0; i < 6; ++i) wanted.push_back(maps_.passes.first.views[i].data->id);
  shelf.BeginEvent();
  EXPECT_FALSE(shelf.EnsureAppearance(map, wanted));
  EXPECT_EQ(WithAppearance(map), 4u);
  shelf.BeginEvent();
  EXPECT_TRUE(shelf.EnsureAppearance(map, wanted));
  EXPECT_EQ(loaded_, wanted) << "each once";
  const KeyFrameData& whole = *maps_.first.keyframe(wanted[0]).data;
  const KeyFrameData& back = *map.keyframe(wanted[0]).data;
  EXPECT_EQ(back.features.descriptors, whole.features.descriptors);
  EXPECT_EQ(back.nodes, whole.nodes);
}

TEST_F(MapShelfTest, WhatCannotBeReadStaysWithout) {
  options_.newest = 0;
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  Store(maps_.first, &shelf);
  shelf.Trim();
  file_.clear();
  shelf.BeginEvent();
  EXPECT_TRUE(shelf.EnsureAppearance(*shelf.FindMap(maps_.first.id()), {maps_.passes.first.views[0].data->id}));
  EXPECT_EQ(shelf.load_failures(), 1u);
}

/// An overlap is found the same with all descriptors in the file.
TEST_F(MapShelfTest, OverlapsAreFoundInMapsWhoseDescriptorsAreInTheFile) {
  options_.memory_mb = 1e-3;
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  Follow(maps_.second, &shelf);
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim();
  OverlapOptions options;
  options.consistent_rounds = 0;
  OverlapDetector detector(options), in_memory(options);
  StageTimes times;
  for (const size_t view : {8, 9}) {
    const KeyFrameId id = maps_.Second(view);
    shelf.BeginEvent();
    const auto found = detector.Detect(*shelf.FindMap(maps_.second.id()), id, *shelf.FindWords(id),
                                       shelf.Others({maps_.first.id()}), shelf.Ensurer(), &times);
    const auto expected = in_memory.Detect(maps_.second, id, maps_.second.keyframe(id).data->bow,
                                           {maps_.FirstAsOther()}, nullptr, &times);
    ASSERT_TRUE(found.confirmed);
    EXPECT_EQ(found.confirmed->matched, expected.confirmed->matched);
    EXPECT_EQ(found.overlap.has_value(), expected.overlap.has_value());
    shelf.Trim();
  }
  EXPECT_GT(shelf.loads(), 0u);
}

/// A new owner begins with a snapshot.
TEST_F(MapShelfTest, PointsKeepTheirDescriptorsThroughASnapshot) {
  options_.newest = 0;
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  Store(maps_.first, &shelf);
  shelf.Trim();
  Map next = maps_.first;
  next.SetEpoch(2);
  shelf.replicas().AddDelta(next.Snapshot());
  ASSERT_EQ(shelf.ApplyPending().size(), 1u);
  const Map& map = *shelf.FindMap(maps_.first.id());
  EXPECT_EQ(map.epoch(), 2u);
  for (const auto& [id, point] : maps_.first.points()) EXPECT_EQ(map.point(id).descriptor, point.descriptor) << id;
}

TEST_F(MapShelfTest, PointsWithoutDescriptorsGetThemWithAKeyFrames) {
  options_.newest = 0;
  MapShelf shelf = MakeShelf();
  for (const auto& [id, keyframe] : maps_.first.keyframes()) shelf.AddKeyFrame(maps_.first.id(), Sent(keyframe));
  Store(maps_.first, &shelf);
  shelf.Trim();  // before any of them is in the map
  shelf.replicas().AddDelta(maps_.first.Snapshot());
  shelf.ApplyPending();
  const Map& map = *shelf.FindMap(maps_.first.id());
  const KeyFrameId id = maps_.passes.first.views[4].data->id;
  const MapPointId landmark = *map.keyframe(id).landmarks.begin();
  EXPECT_EQ(map.point(landmark).descriptor, Descriptor());
  shelf.BeginEvent();
  shelf.EnsureAppearance(map, {id});
  EXPECT_NE(map.point(landmark).descriptor, Descriptor());
}

TEST_F(MapShelfTest, AFusedMapsKeyFramesGoOnInTheOther) {
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  Follow(maps_.second, &shelf);
  shelf.Remove(maps_.second.id(), maps_.first.id());
  EXPECT_EQ(shelf.FindMap(maps_.second.id()), nullptr);
  shelf.replicas().AddDelta(maps_.Joined().Snapshot());
  shelf.ApplyPending();
  EXPECT_EQ(shelf.FindMap(maps_.first.id())->keyframes().size(), 40u);
  EXPECT_EQ(shelf.indexed_keyframes(), 40u);
  EXPECT_TRUE(shelf.TakeTakenIn().empty());
}

TEST_F(MapShelfTest, NoticesAMapThatTookInAnother) {
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  Follow(maps_.second, &shelf);
  shelf.replicas().AddDelta(maps_.Joined().Snapshot());
  shelf.ApplyPending();
  EXPECT_THAT(shelf.TakeTakenIn(), ElementsAre(std::make_pair(maps_.first.id(), maps_.second.id())));
  EXPECT_TRUE(shelf.TakeTakenIn().empty());
}

TEST_F(MapShelfTest, ADeletedMapIsForgotten) {
  MapShelf shelf = MakeShelf();
  Follow(maps_.first, &shelf);
  shelf.Remove(maps_.first.id());
  EXPECT_EQ(shelf.indexed_keyframes(), 0u);
  EXPECT_EQ(shelf.num_appearances(), 0u);
  EXPECT_EQ(shelf.appearance_mb(), 0);
  EXPECT_EQ(shelf.FindWords(maps_.passes.first.views[0].data->id), nullptr);
}

}  // namespace
}  // namespace portolan
