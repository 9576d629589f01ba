#include "atlas/overlap_detector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "atlas/two_maps_test_scene.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

/// Several maps, in one index.
class Shelf {
 public:
  Shelf() = default;
  /// Of one place.
  Shelf(const SyntheticScene& scene, uint32_t number) {
    for (uint32_t i = 0; i < number; ++i) Add(scene);
  }
  MapId Add(const SyntheticScene& scene) {
    MapBuilderOptions options;
    options.map = MapId(0, 1, 10 + static_cast<uint32_t>(maps_.size()));
    maps_.push_back(BuildMap(scene, options));
    for (const auto& [id, keyframe] : maps_.back().keyframes()) words_.Add(id, WordsOf(keyframe.data), options.map);
    return options.map;
  }
  std::vector<OtherMap> AsOthers() const {
    std::vector<OtherMap> others;
    for (const Map& map : maps_) others.push_back(OtherMap::Of(map, &words_));
    return others;
  }

 private:
  std::vector<Map> maps_;
  KeyFrameIndex words_;
};

/// Another place that looks alike in part: walls with the same pattern and something else around them.
TwoMaps MakeLookAlike(uint64_t seed) {
  Random random(seed);
  std::map<int, Descriptor> own;
  return TwoMaps(PlaceSceneOptions(), [&](int landmark, const Descriptor& descriptor) {
    if (landmark % 4 == 0) return descriptor;
    const auto [entry, is_new] = own.try_emplace(landmark);
    if (is_new) entry->second = RandomDescriptor(&random);
    return entry->second;
  });
}

/// Each has candidates for whatever is seen of the place.
Shelf LookAlikes(uint64_t number) {
  Shelf shelf;
  for (uint64_t i = 0; i < number; ++i) shelf.Add(MakeLookAlike(100 + i).passes.second);
  return shelf;
}

class OverlapDetectorTest : public ::testing::Test {
 protected:
  OverlapDetection Detect(OverlapDetector* detector, size_t view,
                          const OverlapDetector::EnsureAppearance& ensure = nullptr) {
    return Detect(detector, view, {maps_.FirstAsOther()}, ensure);
  }
  OverlapDetection Detect(OverlapDetector* detector, size_t view, const std::vector<OtherMap>& others,
                          const OverlapDetector::EnsureAppearance& ensure = nullptr) {
    const KeyFrameId id = maps_.Second(view);
    return detector->Detect(maps_.second, id, maps_.second.keyframe(id).data->bow, others, ensure, &times_);
  }

  const TwoMaps maps_;
  OverlapOptions options_;
  StageTimes times_;
};

TEST_F(OverlapDetectorTest, BelievesAnOverlapThatTwoKeyFramesSee) {
  OverlapDetector detector(options_);
  OverlapDetection detection;
  size_t view = 3;
  int confirmed = 0;
  for (; view < maps_.passes.second.views.size() && !detection.overlap; ++view) {
    detection = Detect(&detector, view);
    confirmed += detection.confirmed ? 1 : 0;
  }
  ASSERT_TRUE(detection.overlap);
  EXPECT_EQ(confirmed, 2);
  EXPECT_EQ(detection.overlap->map, maps_.second.id());
  EXPECT_EQ(detection.overlap->other, maps_.first.id());
  EXPECT_EQ(detection.overlap->current, maps_.Second(view - 1));
  EXPECT_NE(maps_.first.FindKeyFrame(detection.overlap->matched), nullptr);
  EXPECT_THAT(detection.overlap->other_from_map,
              Sim3Near(TwoMaps::SecondFromFirst().Inverse(), PoseTolerance{2e-3, 2e-2}, 2e-3));
  EXPECT_FALSE(times_.samples().at("lookup_words").empty());
}

TEST_F(OverlapDetectorTest, TheFirstKeyFrameHasNoneToBeConsistentWith) {
  OverlapDetector detector(options_);
  const OverlapDetection first = Detect(&detector, 5), second = Detect(&detector, 6);
  EXPECT_GT(first.candidates, 0);
  EXPECT_EQ(first.consistent, 0);
  EXPECT_GT(second.consistent, 0);
  EXPECT_EQ(second.maps, 1u);
  EXPECT_EQ(second.keyframes, 20u);
}

TEST_F(OverlapDetectorTest, ForgettingAMapForgetsWhatWasConfirmed) {
  options_.consistent_rounds = 0;
  for (const MapId forgotten : {maps_.first.id(), maps_.second.id()}) {
    OverlapDetector detector(options_);
    EXPECT_TRUE(Detect(&detector, 8).confirmed);
    detector.Forget(forgotten);
    const OverlapDetection again = Detect(&detector, 9);
    EXPECT_TRUE(again.confirmed);
    EXPECT_FALSE(again.overlap);
  }
}

TEST_F(OverlapDetectorTest, IsDeterministic) {
  OverlapDetector a(options_), b(options_);
  for (size_t view = 3; view < 12; ++view) {
    const OverlapDetection of_a = Detect(&a, view), of_b = Detect(&b, view);
    ASSERT_EQ(of_a.overlap.has_value(), of_b.overlap.has_value());
    if (!of_a.overlap) continue;
    EXPECT_EQ(of_a.overlap->matched, of_b.overlap->matched);
    EXPECT_EQ(of_a.overlap->other_from_map.translation, of_b.overlap->other_from_map.translation);
  }
}

TEST_F(OverlapDetectorTest, RefusesALookAlike) {
  const TwoMaps lookalike = MakeLookAlike(5);
  options_.consistent_rounds = 0;
  OverlapDetector detector(options_);
  size_t refusals = 0;
  std::string reason;
  for (size_t view = 3; view < 15; ++view) {
    const KeyFrameId id = lookalike.Second(view);
    const OverlapDetection detection = detector.Detect(lookalike.second, id, lookalike.second.keyframe(id).data->bow,
                                                       {lookalike.FirstAsOther()}, nullptr, &times_);
    EXPECT_FALSE(detection.confirmed) << view;
    refusals += detection.refusals.size();
    if (!detection.refusals.empty()) reason = detection.refusals.back().reason;
  }
  EXPECT_GT(refusals, 10u);
  EXPECT_THAT(reason, HasSubstr("expected"));
}

TEST_F(OverlapDetectorTest, VerifiesABoundedNumberOverAllMaps) {
  options_.consistent_rounds = 0;
  options_.max_verified = 2;
  const Shelf copies(maps_.passes.first, 4);
  const std::vector<OtherMap> others = copies.AsOthers();
  OverlapDetector detector(options_);
  const OverlapDetection detection = Detect(&detector, 8, others);
  EXPECT_EQ(detection.maps, 4u);
  EXPECT_GT(detection.candidates, 4);
  EXPECT_EQ(detection.verified, 2);
}

TEST_F(OverlapDetectorTest, FindsTheMapThatIsSeenBehindManyThatAreNot) {
  Shelf shelf = LookAlikes(12);
  const MapId seen = shelf.Add(maps_.passes.first);
  const std::vector<OtherMap> others = shelf.AsOthers();
  OverlapDetector detector(options_);
  OverlapDetection detection;
  size_t view = 3;
  for (; view < maps_.passes.second.views.size() && !detection.overlap; ++view) {
    detection = Detect(&detector, view, others);
    EXPECT_LE(detection.verified, options_.max_verified);
  }
  ASSERT_TRUE(detection.overlap);
  EXPECT_EQ(detection.overlap->other, seen);
  EXPECT_LE(view, 7u) << "two keyframes for being consistent, two that agree";
}

TEST_F(OverlapDetectorTest, EachMapHasItsTurnToBeVerified) {
  options_.consistent_rounds = 0;
  std::set<MapId> looked_at;
  const Shelf shelf = LookAlikes(8);
  const std::vector<OtherMap> others = shelf.AsOthers();
  OverlapDetector detector(options_);
  for (size_t lookup = 0; lookup < 8; ++lookup) {
    Detect(&detector, 3 + lookup, others, [&](const Map& map, const std::vector<KeyFrameId>&) {
      if (&map != &maps_.second) looked_at.insert(map.id());
      return true;
    });
  }
  EXPECT_EQ(looked_at.size(), 8u);
}

TEST_F(OverlapDetectorTest, MapsBeyondTheBoundTakeTurns) {
  options_.consistent_rounds = 0;
  options_.max_looked_up = 60;  // of 20 keyframes each: the two before the half is full, and one more
  std::map<const Map*, int> looked_up;
  const Shelf copies(maps_.passes.first, 6);
  const std::vector<OtherMap> others = copies.AsOthers();
  OverlapDetector detector(options_);
  const auto count = [&](const Map& map, const std::vector<KeyFrameId>&) {
    ++looked_up[&map];
    return false;
  };
  options_.max_verified = 100;
  for (size_t lookup = 0; lookup < 32; ++lookup) {  // four turns of eight
    const size_t view = 3 + lookup % 12;
    const OverlapDetection detection = Detect(
        &detector, view, others,
        [&](const Map& map, const std::vector<KeyFrameId>& ids) { return &map == &maps_.second || count(map, ids); });
    EXPECT_EQ(detection.maps, 3u) << view;
    EXPECT_EQ(detection.keyframes, 60u) << view;
  }
  EXPECT_EQ(looked_up.size(), 6u) << "each had its turn";
  EXPECT_GT(looked_up[others[0].open()], looked_up[others[5].open()]) << "the first in order is looked at each time";
}

TEST_F(OverlapDetectorTest, WaitsForDescriptorsThatAreStillBeingRead) {
  options_.consistent_rounds = 0;
  OverlapDetector detector(options_);
  std::vector<KeyFrameId> asked;
  const OverlapDetection waiting = Detect(&detector, 8, [&](const Map& map, const std::vector<KeyFrameId>& ids) {
    if (&map == &maps_.second) return true;
    asked = ids;
    return false;
  });
  EXPECT_FALSE(waiting.confirmed);
  EXPECT_EQ(waiting.verified, 0);
  ASSERT_FALSE(waiting.refusals.empty());
  EXPECT_THAT(waiting.refusals[0].reason, HasSubstr("still being read"));
  EXPECT_EQ(asked.size(), options_.verification.word_keyframes);
  EXPECT_TRUE(Detect(&detector, 9).confirmed);
}

/// Words rank its keyframes; it is opened for what is verified.
TEST_F(OverlapDetectorTest, WaitsForAMapThatIsStillBeingRead) {
  options_.consistent_rounds = 0;
  OverlapDetector detector(options_), in_memory(options_);
  OtherMap other = maps_.FirstAsOther();
  int opened = 0;
  other.open = [&]() -> const Map* {
    ++opened;
    return nullptr;
  };
  const OverlapDetection waiting = Detect(&detector, 8, {other}), expected = Detect(&in_memory, 8);
  EXPECT_EQ(waiting.candidates, expected.candidates);
  EXPECT_EQ(waiting.verified, 0);
  EXPECT_FALSE(waiting.confirmed);
  EXPECT_EQ(opened, waiting.consistent);
  ASSERT_FALSE(waiting.refusals.empty());
  EXPECT_EQ(waiting.refusals[0].other, maps_.first.id());
  EXPECT_THAT(waiting.refusals[0].reason, HasSubstr("map is still being read"));
  other.open = [this] { return &maps_.first; };
  EXPECT_TRUE(Detect(&detector, 9, {other}).confirmed);
}

TEST_F(OverlapDetectorTest, OptionsAreChecked) {
  EXPECT_TRUE(options_.Check().ok());
  options_.max_verified = 0;
  ASSERT_FALSE(options_.Check().ok());
  EXPECT_THAT(options_.Check().error().message, HasSubstr("atlas.max_verified is 0, expected 1 or more"));
}

}  // namespace
}  // namespace portolan
