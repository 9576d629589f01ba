#include "map/map_changes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "map/map_io.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

/// A map, its state at one time, and its changes since.
struct Example {
  Map map{MapId(0, 1, 1), 7};
  RandomEdits edits;
  MapDelta snapshot;
  std::vector<MapDelta> changes;

  explicit Example(uint64_t seed, int num_changes = 20) : edits(seed, &map) {
    for (int i = 0; i < 100; ++i) edits.Next();
    static_cast<void>(map.TakeDelta());
    snapshot = map.Snapshot();
    while (changes.size() < static_cast<size_t>(num_changes)) {
      for (int i = 0; i < 15; ++i) edits.Next();
      MapDelta change = map.TakeDelta();
      if (!change.IsEmpty()) changes.push_back(std::move(change));
    }
  }
  std::string ErrorOfMerging() const {
    const Result<MapDelta> merged = MergeChanges(snapshot, changes);
    return merged ? "" : merged.error().message;
  }
};

TEST(MergeChanges, IsTheSnapshotOfTheMapThatChanged) {
  for (uint64_t seed = 1; seed <= 40; ++seed) {
    Example example(seed);
    if (seed % 2 == 0) example.map.SetResidual(example.map.keyframes().begin()->second.data->camera, {0.02, -0.01});
    example.edits.Edit(RandomEdits::kAddPoint);
    example.changes.push_back(example.map.TakeDelta());
    const Result<MapDelta> merged = MergeChanges(example.snapshot, example.changes);
    ASSERT_TRUE(merged.ok()) << "seed " << seed << ": " << merged.error().message;
    EXPECT_EQ(merged->epoch, example.map.epoch());
    EXPECT_EQ(EncodeSnapshot(*merged), EncodeSnapshot(example.map.Snapshot())) << "seed " << seed;
  }
}

TEST(MergeChanges, WithoutChangesIsTheSnapshotItself) {
  const Example example(1, 0);
  EXPECT_EQ(EncodeSnapshot(MergeChanges(example.snapshot, {}).value()), EncodeSnapshot(example.snapshot));
}

TEST(MergeChanges, RefusesWhatDoesNotGoOn) {
  Example gap(1);
  gap.changes.erase(gap.changes.begin() + 3);
  EXPECT_THAT(gap.ErrorOfMerging(), HasSubstr("does not continue revision 4"));
  Example other_epoch(1);
  ++other_epoch.changes[5].epoch;
  EXPECT_THAT(other_epoch.ErrorOfMerging(), HasSubstr("does not continue"));
  Example other_map(1);
  other_map.changes[0].map = MapId(0, 1, 2);
  EXPECT_THAT(other_map.ErrorOfMerging(), HasSubstr("does not continue"));
  Example whole(1);
  whole.changes[0].base_revision = 0;
  EXPECT_THAT(whole.ErrorOfMerging(), HasSubstr("does not continue"));
  Example unknown_point(1);
  unknown_point.changes[2].observations.push_back({MapPointId(0, 1, 0xfffff0), KeyFrameId(0, 1, 1), 0});
  EXPECT_THAT(unknown_point.ErrorOfMerging(), HasSubstr("which is not there"));
}

}  // namespace
}  // namespace portolan
