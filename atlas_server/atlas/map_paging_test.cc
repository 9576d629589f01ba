// Maps that go to the store and come back.

#include "atlas/map_shelf.h"
#include "atlas/map_store_test_folder.h"
#include "atlas/two_maps_test_scene.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class MapPagingTest : public MapStoreTest {
 protected:
  MapPagingTest() : store_(Open(path_)) { options_.maps_mb = 0; }

  MapShelf MakeShelf() {
    return MapShelf(
        options_, maps_.passes.vocabulary, [this](KeyFrameId id) { return store_->LoadKeyFrame(id); },
        [this](MapId id) { return store_->LoadState(id); });
  }
  void Store(const Map& map, MapShelf* shelf) {
    ASSERT_TRUE(Save(store_.get(), map).ok());
    auto stored = store_->LoadMap(map.id());
    ASSERT_TRUE(stored.ok());
    shelf->TakeIn(std::move(*stored), true, nullptr);
    ASSERT_EQ(shelf->ApplyPending().size(), 1u);
  }
  static KeyFrameData Sent(const KeyFrame& keyframe) {
    KeyFrameData data = *keyframe.data;
    data.bow.clear();
    data.nodes.clear();
    return data;
  }
  static bool Any(const Map&) { return true; }
  /// One bit of a keyframe's data.
  void Damage(KeyFrameId keyframe) {
    store_.reset();
    {
      auto database = SqlDatabase::Open(path_);
      std::string blob;
      {
        auto query = database->Prepare("SELECT data FROM keyframe WHERE id = ?1");
        ASSERT_TRUE(*query->Bind(1, keyframe.value).Step());
        blob = query->Blob(0);
      }
      blob[blob.size() / 2] = static_cast<char>(blob[blob.size() / 2] ^ 1);
      auto update = database->Prepare("UPDATE keyframe SET data = ?1 WHERE id = ?2");
      ASSERT_TRUE(update->Bind(1, std::string_view(blob)).Bind(2, keyframe.value).Step().ok());
    }
    store_ = Open(path_);
  }

  const TwoMaps maps_;
  const MapId first_ = maps_.first.id(), second_ = maps_.second.id();
  ShelfOptions options_;
  std::unique_ptr<MapStore> store_;
};

TEST_F(MapPagingTest, AMapComesBackAsItWas) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  const Map before = *shelf.FindMap(first_);
  shelf.Trim(Any);
  EXPECT_EQ(shelf.FindMap(first_), nullptr);
  EXPECT_EQ(shelf.num_paged(), 1u);
  const Map* map = shelf.BringIn(first_);
  ASSERT_NE(map, nullptr);
  EXPECT_EQ(ToText(MeasureMap(*map)), ToText(MeasureMap(maps_.first)));
  EXPECT_THAT(ValidateMap(*map), IsEmpty());
  for (const auto& [id, point] : before.points()) {
    EXPECT_EQ(map->point(id).descriptor, point.descriptor) << id;
    EXPECT_EQ(map->point(id).max_distance, point.max_distance) << id;
  }
  for (const auto& [id, keyframe] : map->keyframes())
    EXPECT_FALSE(keyframe.data->features.HasAppearance()) << "descriptors stay where they are";
  EXPECT_EQ(shelf.num_paged(), 0u);
  EXPECT_EQ(shelf.map_loads(), 1u);
  EXPECT_EQ(shelf.appearance_mb(), 0);
}

TEST_F(MapPagingTest, APagedMapIsToldOfLikeTheOthers) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim([&](const Map& map) { return map.id() == first_; });
  EXPECT_THAT(shelf.Ids(), ElementsAre(first_, second_));
  EXPECT_EQ(shelf.num_maps(), 2u);
  for (const Map* map : {&maps_.first, &maps_.second}) {
    EXPECT_EQ(ToText(*shelf.Measure(map->id())), ToText(MeasureMap(*map)));
    const MapShelf::Figures figures = *shelf.FiguresOf(map->id());
    EXPECT_EQ(figures.epoch, map->epoch());
    EXPECT_EQ(figures.revision, map->revision());
    EXPECT_EQ(figures.keyframes, map->keyframes().size());
    EXPECT_EQ(figures.points, map->points().size());
    EXPECT_EQ(figures.is_paged, map == &maps_.first);
    EXPECT_FALSE(shelf.IsEmpty(map->id()));
    for (const auto& [id, keyframe] : map->keyframes()) EXPECT_EQ(*shelf.FindWords(id), keyframe.data->bow) << id;
  }
  EXPECT_EQ(shelf.indexed_keyframes(), 40u);
  EXPECT_EQ(shelf.map_loads(), 0u);
  EXPECT_FALSE(shelf.FiguresOf(MapId(9, 9, 9)));
  EXPECT_FALSE(shelf.Measure(MapId(9, 9, 9)));
}

TEST_F(MapPagingTest, ThoseUsedLastStayUpToTheBudget) {
  options_.maps_mb = 1e-6 * static_cast<double>(GeometryBytes(maps_.first) + GeometryBytes(maps_.second));
  MapShelf roomy = MakeShelf();
  Store(maps_.first, &roomy);
  Store(maps_.second, &roomy);
  roomy.Trim(Any);
  EXPECT_EQ(roomy.num_paged(), 0u);
  options_.maps_mb *= 0.75;
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.BringIn(first_);  // where it is
  shelf.Trim(Any);
  EXPECT_NE(shelf.FindMap(first_), nullptr);
  EXPECT_EQ(shelf.FindMap(second_), nullptr);
  shelf.BringIn(second_);
  shelf.Trim(Any);
  EXPECT_EQ(shelf.FindMap(first_), nullptr);
  EXPECT_NE(shelf.FindMap(second_), nullptr);
}

TEST_F(MapPagingTest, TheMapThatWasReadLastStaysWhateverItsSize) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  for (const MapId id : {first_, second_}) {
    shelf.BringIn(id);
    shelf.Trim(Any);
  }
  EXPECT_EQ(shelf.FindMap(first_), nullptr);
  EXPECT_NE(shelf.FindMap(second_), nullptr);
}

TEST_F(MapPagingTest, OnlyMapsThatMayGoDo) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim([](const Map&) { return false; });
  shelf.Trim();
  shelf.Announce(first_, maps_.first.epoch(), maps_.first.revision() + 1);
  MapDelta later = maps_.second.Snapshot();
  later.base_revision = later.revision + 1;
  later.revision += 2;
  shelf.AddChunk({0, 1, later});
  shelf.ApplyPending();
  shelf.Trim(Any);
  EXPECT_EQ(shelf.num_paged(), 0u) << "more is to come of both";
}

TEST_F(MapPagingTest, APlaceIsFoundInAPagedMap) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  const auto is_first = [&](const Map& map) { return map.id() == first_; };
  shelf.Trim(is_first);
  OverlapOptions options;
  options.consistent_rounds = 0;
  OverlapDetector detector(options), in_memory(options);
  StageTimes times;
  for (const size_t view : {8, 9}) {
    const KeyFrameId id = maps_.Second(view);
    shelf.BeginEvent();
    const auto found = detector.Detect(*shelf.FindMap(second_), id, *shelf.FindWords(id), shelf.Others({first_}),
                                       shelf.Ensurer(), &times);
    const auto expected = in_memory.Detect(maps_.second, id, maps_.second.keyframe(id).data->bow,
                                           {maps_.FirstAsOther()}, nullptr, &times);
    EXPECT_EQ(found.candidates, expected.candidates);
    ASSERT_TRUE(found.confirmed);
    EXPECT_EQ(found.confirmed->matched, expected.confirmed->matched);
    EXPECT_EQ(found.confirmed->place.group_inliers, expected.confirmed->place.group_inliers);
    EXPECT_EQ(found.overlap.has_value(), expected.overlap.has_value());
    shelf.Trim(is_first);
  }
  EXPECT_EQ(shelf.map_loads(), 1u);
}

TEST_F(MapPagingTest, WordsThatLeadNowhereReadNoMap) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim([&](const Map& map) { return map.id() == first_; });
  OverlapDetector detector{OverlapOptions()};  // nothing is consistent with the first keyframe
  StageTimes times;
  const KeyFrameId id = maps_.Second(8);
  shelf.BeginEvent();
  const auto found = detector.Detect(*shelf.FindMap(second_), id, *shelf.FindWords(id), shelf.Others({first_}),
                                     shelf.Ensurer(), &times);
  EXPECT_GT(found.candidates, 0);
  EXPECT_EQ(shelf.num_paged(), 1u);
}

TEST_F(MapPagingTest, OneMapIsReadInAnEvent) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim(Any);
  const std::vector<OtherMap> others = shelf.Others({first_, second_});
  ASSERT_EQ(others.size(), 2u);
  shelf.BeginEvent();
  EXPECT_NE(others[0].open(), nullptr);
  EXPECT_FALSE(shelf.came_short());
  EXPECT_EQ(others[1].open(), nullptr);
  EXPECT_TRUE(shelf.came_short());
  EXPECT_NE(others[0].open(), nullptr) << "it is there now";
  shelf.BeginEvent();
  EXPECT_FALSE(shelf.came_short());
  EXPECT_NE(others[1].open(), nullptr);
}

TEST_F(MapPagingTest, LookupsThatFollowEachOtherReadNoMoreMapsThanTheyMay) {
  options_.paged_a_lookup = 5;
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim(Any);
  for (int lookup = 0; lookup < 40; ++lookup) {
    shelf.BeginLookUp();
    for (const OtherMap& other : shelf.Others({first_, second_})) other.open();
    EXPECT_EQ(shelf.map_loads(), 1 + lookup / 4) << lookup << ": 20 keyframes each";
    shelf.Trim(Any);
  }
}

TEST_F(MapPagingTest, AMapThatCanNotBeReadIsNotLookedAtAnyMore) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim(Any);
  Damage(maps_.first.keyframes().begin()->first);
  const std::vector<OtherMap> others = shelf.Others({first_, second_});
  shelf.BeginEvent();
  EXPECT_EQ(others[0].open(), nullptr);
  EXPECT_EQ(shelf.BringIn(first_), nullptr);
  EXPECT_EQ(shelf.map_load_failures(), 1u) << "it is not tried again";
  ASSERT_EQ(shelf.Others({first_, second_}).size(), 1u);
  EXPECT_EQ(shelf.Others({first_, second_})[0].id, second_);
  EXPECT_EQ(ToText(*shelf.Measure(first_)), ToText(MeasureMap(maps_.first))) << "what it was is known";
  EXPECT_FALSE(shelf.IsEmpty(first_));
  EXPECT_NE(shelf.BringIn(second_), nullptr);
  EXPECT_TRUE(store_->LoadState(first_).ok()) << "it stays where it is";

  Map next = maps_.first;  // someone else had it
  next.SetEpoch(2);
  shelf.AddChunk({0, 1, next.Snapshot()});
  for (const auto& [id, keyframe] : next.keyframes()) shelf.AddKeyFrame(first_, Sent(keyframe));
  shelf.ApplyPending();
  ASSERT_NE(shelf.FindMap(first_), nullptr);
  EXPECT_EQ(HashMap(*shelf.FindMap(first_)), HashMap(maps_.first));
  EXPECT_EQ(shelf.Others({first_}).size(), 1u);
  EXPECT_EQ(shelf.indexed_keyframes(), 40u);
}

TEST_F(MapPagingTest, AMapOfWhichTheStoreHasAnotherStateIsNotTaken) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  shelf.Trim(Any);
  MapDelta other = maps_.first.Snapshot();
  ++other.revision;
  ASSERT_TRUE(store_->SaveMap(other).ok());
  EXPECT_EQ(shelf.BringIn(first_), nullptr);
  EXPECT_EQ(shelf.map_load_failures(), 1u);
}

TEST_F(MapPagingTest, NewsOfAPagedMapBringItBack) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  const auto page = [&] {
    shelf.Trim(Any);
    shelf.BringIn(second_);  // which stays, as the last that was read
    shelf.Trim(Any);
    EXPECT_EQ(shelf.FindMap(first_), nullptr);
  };
  Store(maps_.second, &shelf);
  page();
  for (const auto& [id, keyframe] : maps_.first.keyframes()) shelf.AddKeyFrame(first_, Sent(keyframe));
  shelf.AddChunk({0, 1, maps_.first.Snapshot()});
  shelf.Announce(first_, maps_.first.epoch(), maps_.first.revision());
  EXPECT_TRUE(shelf.ApplyPending().empty());
  EXPECT_EQ(shelf.FindMap(first_), nullptr) << "all that is known";

  Map next = maps_.first;
  next.SetPose(next.keyframes().rbegin()->first, Rigid3d());
  shelf.AddChunk({0, 1, next.TakeDelta()});
  EXPECT_EQ(shelf.ApplyPending().size(), 1u);
  EXPECT_EQ(HashMap(*shelf.FindMap(first_)), HashMap(next));
  ASSERT_TRUE(Save(store_.get(), next).ok());

  page();
  shelf.AddKeyFrame(first_, Sent(maps_.second.keyframes().begin()->second));
  EXPECT_NE(shelf.FindMap(first_), nullptr);
  page();
  shelf.Announce(first_, next.epoch(), next.revision() + 1);
  EXPECT_NE(shelf.FindMap(first_), nullptr);
  EXPECT_TRUE(shelf.replicas().IsBehind(first_));
}

TEST_F(MapPagingTest, ADeletedMapIsForgotten) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  shelf.Trim(Any);
  shelf.Remove(first_);
  EXPECT_EQ(shelf.num_paged(), 0u);
  EXPECT_EQ(shelf.indexed_keyframes(), 0u);
  EXPECT_THAT(shelf.Ids(), IsEmpty());
  EXPECT_EQ(shelf.FindWords(maps_.passes.first.views[0].data->id), nullptr);
  for (const auto& [id, keyframe] : maps_.first.keyframes()) shelf.AddKeyFrame(first_, Sent(keyframe));
  shelf.AddChunk({0, 1, maps_.first.Snapshot()});
  shelf.ApplyPending();
  EXPECT_EQ(shelf.FindMap(first_), nullptr) << "what comes late is ignored";
}

TEST_F(MapPagingTest, AFusedMapsKeyFramesGoOnInTheOther) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim([&](const Map& map) { return map.id() == second_; });
  shelf.Remove(second_, first_);
  EXPECT_EQ(shelf.num_paged(), 0u);
  shelf.AddChunk({0, 1, maps_.Joined().Snapshot()});
  shelf.ApplyPending();
  EXPECT_EQ(shelf.FindMap(first_)->keyframes().size(), 40u);
  EXPECT_EQ(shelf.indexed_keyframes(), 40u);
}

TEST_F(MapPagingTest, NoticesAMapThatTookInAPagedOne) {
  MapShelf shelf = MakeShelf();
  Store(maps_.first, &shelf);
  Store(maps_.second, &shelf);
  shelf.Trim([&](const Map& map) { return map.id() == second_; });
  shelf.AddChunk({0, 1, maps_.Joined().Snapshot()});
  for (const auto& [id, keyframe] : maps_.second.keyframes()) shelf.AddKeyFrame(first_, Sent(keyframe));
  shelf.ApplyPending();
  EXPECT_THAT(shelf.TakeTakenIn(), ElementsAre(std::make_pair(first_, second_)));
}

}  // namespace
}  // namespace portolan
