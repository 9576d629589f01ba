#include "mapping/successors.h"

#include <gtest/gtest.h>

#include "base/ids.h"

namespace portolan {
namespace {

TEST(Successors, FollowsChains) {
  Successors<MapPointId> successors;
  const MapPointId a(1, 1, 1), b(1, 1, 2), c(1, 1, 3);
  successors.Note(a, b);
  successors.Note(b, c);
  EXPECT_EQ(successors.Follow(a), c);
  EXPECT_EQ(successors.Follow(b), c);
  EXPECT_EQ(successors.Follow(c), c);
}

TEST(Successors, TakesOverWhatAnotherNoted) {
  Successors<MapPointId> successors, other;
  const MapPointId a(1, 1, 1), b(1, 1, 2), c(1, 1, 3), d(1, 1, 4);
  other.Note(a, b);
  other.Note(b, c);
  successors.Note(c, d);
  successors.Add(other);
  EXPECT_EQ(successors.Follow(a), d);
}

TEST(Successors, ForgetsTheOldest) {
  Successors<MapPointId> successors;
  const auto id = [](uint32_t sequence) { return MapPointId(1, 1, sequence); };
  for (uint32_t k = 1; k <= 30000; ++k) successors.Note(id(k), id(100000 + k));
  EXPECT_EQ(successors.Follow(id(30000)), id(130000));
  EXPECT_EQ(successors.Follow(id(1)), id(1));
}

}  // namespace
}  // namespace portolan
