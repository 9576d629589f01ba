#include "base/ids.h"

#include <gtest/gtest.h>

#include <set>
#include <sstream>
#include <type_traits>
#include <unordered_set>

namespace portolan {
namespace {

TEST(IdsTest, KeepsItsThreeParts) {
  const KeyFrameId id(65535, 0xffffff, 0xffffff);
  EXPECT_EQ(id.robot(), 65535);
  EXPECT_EQ(id.session(), 0xffffffu);
  EXPECT_EQ(id.sequence(), 0xffffffu);
  const KeyFrameId other(1, 2, 3);
  EXPECT_EQ(other.robot(), 1);
  EXPECT_EQ(other.session(), 2u);
  EXPECT_EQ(other.sequence(), 3u);
  EXPECT_EQ(KeyFrameId(other.value), other);
}

TEST(IdsTest, DefaultIsNone) {
  EXPECT_FALSE(MapId().IsValid());
  EXPECT_EQ(ToString(MapId()), "none");
  EXPECT_TRUE(MapId(0, 1, 1).IsValid());
}

TEST(IdsTest, OrdersByRobotSessionSequence) {
  EXPECT_LT(MapPointId(0, 9, 9), MapPointId(1, 1, 1));
  EXPECT_LT(MapPointId(1, 1, 9), MapPointId(1, 2, 1));
  EXPECT_LT(MapPointId(1, 1, 1), MapPointId(1, 1, 2));
}

TEST(IdsTest, KindsOfIdsDoNotMix) {
  static_assert(!std::is_convertible_v<KeyFrameId, MapPointId>);
  static_assert(!std::is_convertible_v<uint64_t, KeyFrameId>);
}

TEST(IdsTest, WritesItselfAsRobotSessionSequence) {
  std::ostringstream out;
  out << KeyFrameId(0, 0x3fa21c, 17);
  EXPECT_EQ(out.str(), "0.3fa21c.17");
  EXPECT_EQ(ToString(KeyFrameId(12, 0xab, 1)), "12.0000ab.1");
}

TEST(IdsTest, MinterCountsFromOneWithinItsSession) {
  IdMinter<MapId> minter(7, 42);
  EXPECT_EQ(minter.Next(), MapId(7, 42, 1));
  EXPECT_EQ(minter.Next(), MapId(7, 42, 2));
}

TEST(IdsTest, MinterStartsANewSessionWhenTheSequenceIsUsedUp) {
  IdMinter<MapPointId> minter(3, 0);  // a session that DrawSession() never gives
  MapPointId id;
  for (uint32_t i = 0; i < 0xffffffu; ++i) id = minter.Next();
  EXPECT_EQ(id, MapPointId(3, 0, 0xffffff));
  const MapPointId next = minter.Next();
  EXPECT_EQ(next.sequence(), 1u);
  EXPECT_NE(next.session(), 0u);
  EXPECT_EQ(next.robot(), 3);
}

/// 64 draws out of 2^24 collide with a probability of 0.0001: two repeats would mean that the source is not random.
TEST(IdsTest, SessionsAreDrawnAnewAndFitTheirBits) {
  std::set<uint32_t> sessions;
  for (int i = 0; i < 64; ++i) {
    const uint32_t session = DrawSession();
    EXPECT_GE(session, 1u);
    EXPECT_LE(session, 0xffffffu);
    sessions.insert(session);
  }
  EXPECT_GE(sessions.size(), 63u);
}

TEST(IdsTest, HashSpreadsNeighbours) {
  std::unordered_set<size_t> low_bits;
  IdMinter<KeyFrameId> minter(1, 5);
  for (int i = 0; i < 1024; ++i) low_bits.insert(std::hash<KeyFrameId>()(minter.Next()) % 4096);
  EXPECT_GT(low_bits.size(), 700u);  // at random, 1024 of 4096 places give 906 different ones
}

}  // namespace
}  // namespace portolan
