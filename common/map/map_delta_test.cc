#include "map/map_delta.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "map/map.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

size_t CountElements(const MapDelta& d) {
  return d.removed_points.size() + d.removed_keyframes.size() + d.keyframes.size() + d.points.size() +
         d.observations.size();
}

/// A delta with something in each of its lists, and the data it needs.
struct Example {
  Map owner{MapId(0, 1, 1), 1};
  RandomEdits edits{3, &owner};
  MapDelta first = owner.TakeDelta();
  MapDelta delta;

  Example() {
    do {
      for (int i = 0; i < 100; ++i) edits.Next();
      static_cast<void>(owner.TakeDelta());
      before = owner;
      for (int i = 0; i < 100; ++i) edits.Next();
      delta = owner.TakeDelta();
    } while (delta.removed_keyframes.empty() || delta.removed_points.empty());
  }
  Map before;
};

uint64_t HashAfter(const Example& example, const MapDelta& delta) {
  Map replica = example.before;
  const Status applied = replica.Apply(delta, example.edits.FindData());
  EXPECT_TRUE(applied.ok()) << (applied.ok() ? "" : applied.error().message);
  return HashMap(replica);
}

class ChunkSizeTest : public ::testing::TestWithParam<size_t> {};

TEST_P(ChunkSizeTest, ChunksInAnyOrderAndRepeatedGiveTheDeltaBack) {
  Example example;
  const std::vector<MapDeltaChunk> chunks = SplitDelta(example.delta, GetParam());
  const size_t elements = CountElements(example.delta);
  EXPECT_EQ(chunks.size(), (elements + GetParam() - 1) / GetParam());
  for (const MapDeltaChunk& chunk : chunks) EXPECT_LE(CountElements(chunk.part), GetParam());

  Random random(GetParam());
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<size_t> order;
    for (size_t i = 0; i < chunks.size(); ++i) order.push_back(i);
    for (size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random.Below(i)]);
    DeltaAssembler assembler;
    std::vector<MapDelta> whole;
    for (size_t k = 0; k < order.size(); ++k) {
      EXPECT_TRUE(whole.empty());
      if (k > 0) {
        EXPECT_TRUE(assembler.Add(chunks[order[random.Below(k)]]).empty());  // one that came already
      }
      whole = assembler.Add(chunks[order[k]]);
    }
    ASSERT_EQ(whole.size(), 1u);
    EXPECT_EQ(whole[0].base_revision, example.delta.base_revision);
    EXPECT_EQ(whole[0].revision, example.delta.revision);
    EXPECT_EQ(CountElements(whole[0]), elements);
    EXPECT_EQ(HashAfter(example, whole[0]), HashMap(example.owner));
    EXPECT_EQ(assembler.dropped(), 0u);
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, ChunkSizeTest, ::testing::Values(1, 3, 7, 50));

TEST(SplitDelta, EmptyDeltaIsOneChunkAndZeroMeansOne) {
  MapDelta empty;
  empty.map = MapId(0, 1, 1);
  ASSERT_EQ(SplitDelta(empty, 10).size(), 1u);
  empty.points.resize(3);
  EXPECT_EQ(SplitDelta(empty, 0).size(), 3u);
}

TEST(DeltaAssembler, DeltasMayInterleave) {
  Example example;
  const auto a = SplitDelta(example.first, 4), b = SplitDelta(example.delta, 4);
  DeltaAssembler assembler;
  size_t whole = 0;
  for (size_t i = 0; i < std::max(a.size(), b.size()); ++i) {
    if (i < a.size()) whole += assembler.Add(a[i]).size();
    if (i < b.size()) whole += assembler.Add(b[i]).size();
  }
  EXPECT_EQ(whole, 2u);
}

MapDeltaChunk ChunkOf(Revision revision, uint32_t index, uint32_t count) {
  MapDeltaChunk chunk;
  chunk.index = index;
  chunk.count = count;
  chunk.part.revision = revision;
  chunk.part.base_revision = revision - 1;
  return chunk;
}

TEST(DeltaAssembler, KeepsABoundedNumberOfUnfinishedDeltas) {
  DeltaAssembler assembler;
  for (Revision revision = 1; revision <= 20; ++revision) EXPECT_TRUE(assembler.Add(ChunkOf(revision, 0, 2)).empty());
  EXPECT_EQ(assembler.dropped(), 12u);
  EXPECT_TRUE(assembler.Add(ChunkOf(5, 1, 2)).empty());    // its first half is gone
  EXPECT_EQ(assembler.Add(ChunkOf(20, 1, 2)).size(), 1u);  // the newest are there
}

TEST(DeltaAssembler, ContradictingCountStartsAnew) {
  DeltaAssembler assembler;
  EXPECT_TRUE(assembler.Add(ChunkOf(1, 0, 3)).empty());
  EXPECT_TRUE(assembler.Add(ChunkOf(1, 0, 2)).empty());
  EXPECT_EQ(assembler.dropped(), 1u);
  EXPECT_EQ(assembler.Add(ChunkOf(1, 1, 2)).size(), 1u);
}

TEST(DeltaAssembler, IndexBeyondCountIsIgnored) {
  DeltaAssembler assembler;
  EXPECT_TRUE(assembler.Add(ChunkOf(1, 2, 2)).empty());
  EXPECT_TRUE(assembler.Add(ChunkOf(2, 0, 0)).empty());
  EXPECT_TRUE(assembler.Add(ChunkOf(3, 1, 1)).empty());
  EXPECT_EQ(assembler.pending_bytes(), 0u);
  EXPECT_TRUE(assembler.Add(ChunkOf(1, 0, 2)).empty());
  EXPECT_EQ(assembler.Add(ChunkOf(1, 1, 2)).size(), 1u);
}

constexpr uint32_t kHugeCount = 4000000000u;

TEST(DeltaAssembler, HoldsWhatCameAndNotWhatIsClaimed) {
  DeltaAssembler assembler;
  for (Revision revision = 1; revision <= 8; ++revision) {
    EXPECT_TRUE(assembler.Add(ChunkOf(revision, kHugeCount - 1, kHugeCount)).empty());
  }
  EXPECT_EQ(assembler.dropped(), 0u);
  EXPECT_LT(assembler.pending_bytes(), 8u * 1024);
  for (int repeated = 0; repeated < 1000; ++repeated) assembler.Add(ChunkOf(8, 0, kHugeCount));
  EXPECT_LT(assembler.pending_bytes(), 9u * 1024) << "a chunk that comes again is not held again";
}

TEST(DeltaAssembler, BoundsWhatUnfinishedDeltasTake) {
  constexpr size_t kMaxBytes = 100000;
  for (const size_t points : {size_t{0}, size_t{10}, size_t{1000}, kMaxBytes / 16}) {
    DeltaAssembler assembler(kMaxBytes);
    for (uint32_t index = 0; index < 2000; ++index) {
      MapDeltaChunk chunk = ChunkOf(1 + index % 7, index, kHugeCount);
      chunk.part.points.resize(points);
      EXPECT_TRUE(assembler.Add(chunk).empty());
      ASSERT_LE(assembler.pending_bytes(), kMaxBytes);
    }
    EXPECT_GT(assembler.dropped(), 0u);
  }
}

TEST(DeltaAssembler, OneThatTakesAllTheRoomDoesNotPushOutTheOthers) {
  constexpr size_t kMaxBytes = 100000;
  DeltaAssembler assembler(kMaxBytes);
  EXPECT_TRUE(assembler.Add(ChunkOf(1, 0, 2)).empty());
  for (uint32_t index = 0; index < 1000; ++index) {
    MapDeltaChunk chunk = ChunkOf(2, index, kHugeCount);
    chunk.part.observations.resize(100);
    EXPECT_TRUE(assembler.Add(chunk).empty());
  }
  EXPECT_GT(assembler.dropped(), 10u);
  EXPECT_EQ(assembler.Add(ChunkOf(1, 1, 2)).size(), 1u);
}

TEST(DeltaAssembler, RoomIsFreeAgainAfterAWholeDelta) {
  DeltaAssembler assembler;
  EXPECT_TRUE(assembler.Add(ChunkOf(1, 0, 2)).empty());
  EXPECT_GT(assembler.pending_bytes(), 0u);
  EXPECT_EQ(assembler.Add(ChunkOf(1, 1, 2)).size(), 1u);
  EXPECT_EQ(assembler.pending_bytes(), 0u);
}

}  // namespace
}  // namespace portolan
