#include "base/hash.h"

#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

namespace portolan {
namespace {

uint64_t HashOf(const std::string& bytes) {
  Hasher hasher;
  hasher.AddBytes(bytes.data(), bytes.size());
  return hasher.Value();
}

TEST(HashTest, EqualBytesHaveEqualHashes) {
  EXPECT_EQ(HashOf("portolan"), HashOf("portolan"));
}

TEST(HashTest, EveryBitOfTheInputCounts) {
  const std::string bytes = "a chart of the sea, 27 bytes";
  std::set<uint64_t> hashes{HashOf(bytes)};
  for (size_t i = 0; i < bytes.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      std::string changed = bytes;
      changed[i] = static_cast<char>(changed[i] ^ (1 << bit));
      hashes.insert(HashOf(changed));
    }
  }
  EXPECT_EQ(hashes.size(), 1 + 8 * bytes.size());
}

TEST(HashTest, OrderAndLengthCount) {
  EXPECT_NE(HashOf("12345678abcdefgh"), HashOf("abcdefgh12345678"));
  EXPECT_NE(HashOf(std::string(8, '\0')), HashOf(std::string(16, '\0')));
  EXPECT_NE(HashOf(""), HashOf(std::string(1, '\0')));
}

TEST(HashTest, ReadingTheValueLeavesTheStateAlone) {
  Hasher once;
  once.Add(1);
  once.Add(2);
  Hasher read_between;
  read_between.Add(1);
  EXPECT_EQ(read_between.Value(), read_between.Value());
  read_between.Add(2);
  EXPECT_EQ(once.Value(), read_between.Value());
}

/// Half the bits of the hash flip, on average, when one bit of the input does: 32 of 64, sigma of the mean 4 / sqrt(64)
/// = 0.5.
TEST(HashTest, OneBitChangesHalfOfTheHash) {
  const uint64_t word = 0x0123456789abcdefull;
  Hasher reference;
  reference.Add(word);
  double flipped = 0;
  for (int bit = 0; bit < 64; ++bit) {
    Hasher changed;
    changed.Add(word ^ (uint64_t{1} << bit));
    flipped += __builtin_popcountll(changed.Value() ^ reference.Value());
  }
  EXPECT_NEAR(flipped / 64, 32, 5 * 0.5);
}

TEST(HashTest, FormatsSixteenDigits) {
  EXPECT_EQ(FormatHash(0), "0000000000000000");
  EXPECT_EQ(FormatHash(0xdeadbeefull), "00000000deadbeef");
}

}  // namespace
}  // namespace portolan
