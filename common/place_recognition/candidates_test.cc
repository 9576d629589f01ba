#include "place_recognition/candidates.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "base/random.h"

namespace portolan {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

/// A map of keyframes with bags given word by word; landmarks tie the keyframes that are neighbours.
class CandidatesTest : public ::testing::Test {
 protected:
  static KeyFrameId Id(uint32_t number) { return KeyFrameId(0, 1, number); }

  static BowVector Bag(const std::vector<uint32_t>& words) {
    BowVector bow;
    for (const uint32_t word : words) bow.emplace_back(word, 1.0f / static_cast<float>(words.size()));
    return bow;
  }
  void AddKeyFrame(uint32_t number, const std::vector<uint32_t>& words) {
    KeyFrameData data;
    data.id = Id(number);
    data.camera = PinholeCamera{500, 500, 319.5, 239.5, 640, 480};
    data.features.pixels_px.resize(50, {10, 10});
    data.features.octaves.resize(50);
    data.features.angles_rad.resize(50);
    data.features.descriptors.resize(50);
    map_.AddKeyFrame(MakeKeyFrameData(std::move(data), nullptr), Rigid3d(), number > 1 ? Id(1) : KeyFrameId());
    index_.Add(Id(number), std::make_shared<const BowVector>(Bag(words)));
  }
  void Tie(uint32_t a, uint32_t b, uint32_t feature) {
    const MapPointId id(0, 1, ++last_point_);
    map_.AddPoint(id, {0, 0, 1});
    ASSERT_TRUE(map_.AddObservation(id, Id(a), feature));
    ASSERT_TRUE(map_.AddObservation(id, Id(b), feature));
  }
  std::vector<KeyFrameId> Find(const std::vector<uint32_t>& words, const CandidateOptions& options = {},
                               const std::function<bool(KeyFrameId)>& exclude = nullptr) {
    std::vector<KeyFrameId> ids;
    for (const Candidate& candidate : FindCandidates(Bag(words), index_, map_, options, exclude))
      ids.push_back(candidate.keyframe);
    return ids;
  }

  Map map_{MapId(0, 1, 1), 1};
  KeyFrameIndex index_;
  uint32_t last_point_ = 0;
};

TEST_F(CandidatesTest, NeedsOfAMapTheNeighboursAlone) {
  for (const uint32_t number : {1, 2, 3}) AddKeyFrame(number, {1, 2, 3, 4});
  Tie(1, 2, 0);
  EXPECT_EQ(NeighboursIn(map_)(Id(1), 10), std::vector<KeyFrameId>{Id(2)});
  EXPECT_FALSE(NeighboursIn(map_)(Id(9), 10)) << "not in the map";
  CandidateOptions options;
  options.min_score = 0;
  const std::vector<SharedWords> shared = index_.Query(Bag({1, 2, 3, 4}));
  const auto all = FindCandidates(shared, map_, options, nullptr);
  const auto without_third = [&](KeyFrameId id, size_t most) {
    return id == Id(3) ? std::nullopt : NeighboursIn(map_)(id, most);
  };
  const auto known = FindCandidates(shared, without_third, options, nullptr);
  ASSERT_THAT(all, SizeIs(3));
  ASSERT_THAT(known, SizeIs(2));
  for (size_t i = 0; i < known.size(); ++i) {
    EXPECT_EQ(known[i].keyframe, all[i].keyframe);
    EXPECT_EQ(known[i].accumulated_score, 2);
  }
}

TEST_F(CandidatesTest, FindsTheKeyFrameWithTheSameWords) {
  AddKeyFrame(1, {1, 2, 3, 4});
  AddKeyFrame(2, {11, 12, 13, 14});
  AddKeyFrame(3, {21, 22, 23, 24});
  const auto candidates = FindCandidates(Bag({11, 12, 13, 14}), index_, map_, {}, nullptr);
  ASSERT_THAT(candidates, SizeIs(1));
  EXPECT_EQ(candidates[0].keyframe, Id(2));
  EXPECT_NEAR(candidates[0].score, 1, 1e-6);
  EXPECT_NEAR(candidates[0].accumulated_score, 1, 1e-6);
}

TEST_F(CandidatesTest, AccumulatesOverCovisibleKeyFrames) {
  // 1 is the best alone; 2 and 3 support each other.
  AddKeyFrame(1, {1, 2, 3, 4, 5, 6});
  AddKeyFrame(2, {1, 2, 3, 4, 5, 90});
  AddKeyFrame(3, {1, 2, 3, 4, 91, 92});
  Tie(2, 3, 0);
  const auto candidates = FindCandidates(Bag({1, 2, 3, 4, 5, 6}), index_, map_, {}, nullptr);
  ASSERT_THAT(candidates, SizeIs(1));  // 1 has under 75 % of their sum; of the two, the better
  EXPECT_EQ(candidates[0].keyframe, Id(2));
  EXPECT_NEAR(candidates[0].score, 5.0 / 6, 1e-6);
  EXPECT_NEAR(candidates[0].accumulated_score, 5.0 / 6 + 4.0 / 6, 1e-6);
  CandidateOptions lenient;
  lenient.min_score = 0.5;
  EXPECT_EQ(Find({1, 2, 3, 4, 5, 6}, lenient), (std::vector<KeyFrameId>{Id(2), Id(1)}));  // best first
}

TEST_F(CandidatesTest, FewSharedWordsDoNotCount) {
  AddKeyFrame(1, {1, 2, 3, 4, 5, 6});
  AddKeyFrame(2, {1, 2, 93, 94, 95, 96});  // 2 of the most, 6: under half
  Tie(1, 2, 0);
  const auto candidates = FindCandidates(Bag({1, 2, 3, 4, 5, 6}), index_, map_, {}, nullptr);
  ASSERT_THAT(candidates, SizeIs(1));
  EXPECT_NEAR(candidates[0].accumulated_score, 1, 1e-6);
}

TEST_F(CandidatesTest, LeavesOutWhatIsExcludedOrOfAnotherMap) {
  AddKeyFrame(1, {1, 2, 3, 4});
  AddKeyFrame(2, {1, 2, 3, 5});
  index_.Add(Id(77), std::make_shared<const BowVector>(Bag({1, 2, 3, 4})));  // not in the map
  CandidateOptions lenient;
  lenient.min_score = 0.5;
  EXPECT_EQ(Find({1, 2, 3, 4}, lenient), (std::vector<KeyFrameId>{Id(1), Id(2)}));
  EXPECT_EQ(Find({1, 2, 3, 4}, lenient, [](KeyFrameId id) { return id == Id(1); }), (std::vector<KeyFrameId>{Id(2)}));
  EXPECT_THAT(Find({1, 2, 3, 4}, lenient, [](KeyFrameId) { return true; }), IsEmpty());
}

TEST_F(CandidatesTest, NumberIsBounded) {
  for (uint32_t i = 1; i <= 20; ++i) AddKeyFrame(i, {1, 2, 3, 4});
  CandidateOptions options;
  options.most = 7;
  EXPECT_THAT(Find({1, 2, 3, 4}, options), SizeIs(7));
}

TEST_F(CandidatesTest, OnlyThoseWithTheMostWordsAreScored) {
  AddKeyFrame(1, {1, 2, 3, 4, 5, 6});
  AddKeyFrame(2, {1, 2, 3, 4, 5, 90});
  AddKeyFrame(3, {1, 2, 3, 4, 91, 92});
  CandidateOptions options;
  options.min_score = 0;
  EXPECT_THAT(Find({1, 2, 3, 4, 5, 6}, options), SizeIs(3));
  options.most_scored = 2;
  EXPECT_EQ(Find({1, 2, 3, 4, 5, 6}, options), (std::vector<KeyFrameId>{Id(1), Id(2)}));
}

/// Ids of those that should be scored, by comparing with every bag.
std::set<KeyFrameId> ScoredByComparison(const BowVector& bow, const KeyFrameIndex& index, const Map& map,
                                        const CandidateOptions& options,
                                        const std::function<bool(KeyFrameId)>& exclude) {
  std::vector<std::pair<int, KeyFrameId>> shared;  // words, negative
  for (const auto& [id, keyframe] : map.keyframes()) {
    const int words = CountCommonWords(bow, *index.Find(id));
    if (words > 0 && !exclude(id)) shared.emplace_back(-words, id);
  }
  std::sort(shared.begin(), shared.end());
  std::set<KeyFrameId> scored;
  for (const auto& [words, id] : shared) {
    if (options.most_scored > 0 && scored.size() == options.most_scored) break;
    if (words <= options.min_shared_words * shared.front().first) scored.insert(id);
  }
  return scored;
}

TEST_F(CandidatesTest, ScoresWhatAComparisonWithAllWouldScore) {
  Random random(1);
  const auto draw_words = [&] {
    std::set<uint32_t> words;
    for (int i = 0; i < 12; ++i) words.insert(static_cast<uint32_t>(random.Below(40)));
    return std::vector<uint32_t>(words.begin(), words.end());
  };
  for (uint32_t number = 1; number <= 60; ++number) AddKeyFrame(number, draw_words());
  // Of no map.
  for (uint32_t number = 1000; number < 1020; ++number)
    index_.Add(Id(number), std::make_shared<const BowVector>(Bag(draw_words())));
  CandidateOptions options;
  options.min_score = 0;  // nothing ties them: each that is scored is a candidate
  options.most = 100;
  size_t found = 0;
  for (int query = 0; query < 200; ++query) {
    options.most_scored = random.Below(8);
    options.min_shared_words = random.Uniform(0.2, 1);
    const uint32_t left_out = static_cast<uint32_t>(random.Below(5));
    const auto exclude = [&](KeyFrameId id) { return id.sequence() % 5 == left_out; };
    const std::vector<uint32_t> words = draw_words();
    const std::vector<KeyFrameId> candidates = Find(words, options, exclude);
    EXPECT_EQ(std::set<KeyFrameId>(candidates.begin(), candidates.end()),
              ScoredByComparison(Bag(words), index_, map_, options, exclude));
    found += candidates.size();
  }
  EXPECT_GT(found, 500u);
}

TEST_F(CandidatesTest, NothingInCommonIsNothing) {
  EXPECT_THAT(Find({1, 2}), IsEmpty());
  AddKeyFrame(1, {1, 2, 3, 4});
  EXPECT_THAT(Find({7, 8}), IsEmpty());
  EXPECT_THAT(Find({}), IsEmpty());
}

}  // namespace
}  // namespace portolan
