#include "vocabulary/keyframe_index.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <utility>

#include "base/random.h"

namespace portolan {
namespace {

BowVector RandomBow(Random* random) {
  std::set<uint32_t> words;
  for (uint64_t i = 0, count = random->Below(12); i < count; ++i)
    words.insert(static_cast<uint32_t>(random->Below(40)));
  BowVector bow;
  for (uint32_t word : words) bow.emplace_back(word, 1.0f / static_cast<float>(words.size()));
  return bow;
}

std::shared_ptr<const BowVector> Share(BowVector bow) {
  return std::make_shared<const BowVector>(std::move(bow));
}

KeyFrameId Key(uint32_t sequence) {
  return KeyFrameId(1, 2, sequence);
}

/// What a query should give, by comparing with every bag.
std::vector<SharedWords> SearchAll(const std::map<KeyFrameId, BowVector>& bags, const BowVector& query) {
  std::vector<SharedWords> shared;
  for (const auto& [keyframe, bow] : bags) {
    const int words = CountCommonWords(bow, query);
    if (words > 0) shared.push_back({keyframe, words, BowScore(bow, query)});
  }
  std::stable_sort(shared.begin(), shared.end(),
                   [](const SharedWords& a, const SharedWords& b) { return a.words > b.words; });
  return shared;
}

void ExpectSame(const std::vector<SharedWords>& a, const std::vector<SharedWords>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].keyframe, b[i].keyframe);
    EXPECT_EQ(a[i].words, b[i].words);
    EXPECT_DOUBLE_EQ(a[i].score, b[i].score);
  }
}

TEST(KeyFrameIndex, AgreesWithASearchOfAllThroughChanges) {
  Random random(1);
  KeyFrameIndex index;
  std::map<KeyFrameId, BowVector> bags;
  for (int step = 0; step < 2000; ++step) {
    const KeyFrameId keyframe = Key(1 + static_cast<uint32_t>(random.Below(50)));
    if (random.Below(3) == 0) {
      index.Remove(keyframe);
      bags.erase(keyframe);
    } else {
      bags[keyframe] = RandomBow(&random);  // anew or in place of another
      index.Add(keyframe, Share(bags[keyframe]));
    }
    EXPECT_EQ(index.size(), bags.size());
    const BowVector query = RandomBow(&random);
    ExpectSame(index.Query(query), SearchAll(bags, query));
  }
  for (uint32_t sequence = 1; sequence <= 50; ++sequence) {
    const BowVector* bow = index.Find(Key(sequence));
    const auto expected = bags.find(Key(sequence));
    ASSERT_EQ(bow != nullptr, expected != bags.end());
    if (bow != nullptr) {
      EXPECT_EQ(*bow, expected->second);
    }
  }
}

TEST(KeyFrameIndex, PartsAgreeWithAnIndexForEachMapThroughChanges) {
  Random random(2);
  KeyFrameIndex index;
  std::map<MapId, KeyFrameIndex> each;
  const std::vector<MapId> maps{MapId(0, 1, 4), MapId(0, 1, 2), MapId(0, 1, 3)};
  for (int step = 0; step < 3000; ++step) {
    const MapId map = maps[random.Below(maps.size())];
    const KeyFrameId keyframe = Key(1 + static_cast<uint32_t>(random.Below(30)));  // some are in several maps
    if (random.Below(100) == 0) {
      index.RemovePart(map);
      each.erase(map);
    } else if (random.Below(4) == 0) {
      index.Remove(keyframe, map);
      each[map].Remove(keyframe);
    } else {
      const auto bow = Share(RandomBow(&random));
      index.Add(keyframe, bow, map);
      each[map].Add(keyframe, bow);
    }
    const BowVector query = RandomBow(&random);
    const auto shared = index.Query(query, maps);
    ASSERT_EQ(shared.size(), maps.size());
    size_t total = 0;
    for (size_t i = 0; i < maps.size(); ++i) {
      ExpectSame(shared[i], each[maps[i]].Query(query));
      ASSERT_EQ(index.size(maps[i]), each[maps[i]].size());
      total += index.size(maps[i]);
    }
    ASSERT_EQ(index.total_size(), total);
    ExpectSame(index.Query(query, {maps[1]}).front(), shared[1]);
    EXPECT_EQ(index.Find(keyframe, map), each[map].Find(keyframe));
  }
  EXPECT_TRUE(index.Query({{1, 1.0f}}).empty()) << "nothing is in the part without a name";
  EXPECT_TRUE(index.Query({{1, 1.0f}}, {MapId(9, 9, 9)}).front().empty());
  index.RemovePart(MapId(9, 9, 9));
}

TEST(KeyFrameIndex, SortsByWordsThenById) {
  KeyFrameIndex index;
  index.Add(Key(3), Share({{1, 0.5f}, {2, 0.5f}}));
  index.Add(Key(2), Share({{1, 0.5f}, {9, 0.5f}}));
  index.Add(Key(1), Share({{2, 0.5f}, {9, 0.5f}}));
  ExpectSame(index.Query({{1, 0.5f}, {2, 0.5f}}), {{Key(3), 2, 1.0}, {Key(1), 1, 0.5}, {Key(2), 1, 0.5}});
}

TEST(KeyFrameIndex, SharesTheBagWhileItIsIndexed) {
  KeyFrameIndex index;
  const auto bow = Share({{1, 0.5f}, {2, 0.5f}});
  index.Add(Key(1), bow);
  EXPECT_EQ(index.Find(Key(1)), bow.get());
  EXPECT_EQ(bow.use_count(), 2);
  index.Remove(Key(1));
  EXPECT_EQ(bow.use_count(), 1);
}

TEST(KeyFrameIndex, UnknownIdsAndEmptyBagsDoNoHarm) {
  KeyFrameIndex index;
  index.Remove(Key(1));
  EXPECT_EQ(index.Find(Key(1)), nullptr);
  index.Add(Key(1), Share({}));
  EXPECT_EQ(index.size(), 1u);
  EXPECT_TRUE(index.Query({{1, 1.0f}}).empty());
  EXPECT_TRUE(index.Query({}).empty());
  index.Remove(Key(1));
  EXPECT_EQ(index.size(), 0u);
}

}  // namespace
}  // namespace portolan
