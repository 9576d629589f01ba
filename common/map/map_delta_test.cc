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
  EXPECT_TRUE(assembler.Add(ChunkOf(1, 0, 2)).empty());
  EXPECT_EQ(assembler.Add(ChunkOf(1, 1, 2)).size(), 1u);
}

}  // namespace
}  // namespace portolan
