#include "place_recognition/sim3_verification.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "place_recognition/place_test_scene.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

constexpr double kFirstScale = 2.0, kSecondScale = 0.5;
constexpr size_t kQuery = 5, kCandidate = 4;  // views

SyntheticSceneOptions SceneOptions() {
  SyntheticSceneOptions options;
  options.num_landmarks = 400;
  options.num_clutter = 200;
  options.travel = 1.5;
  options.descriptor_flip_ratio = 0.03;
  return options;
}

/// The first pass is the candidate's map, the second the query's, each in its own frame and scale.
struct TwoMaps {
  explicit TwoMaps(const TwoPasses& passes, double point_sigma = 0)
      : candidate(BuildMap(passes.first, Options(kFirstScale, 1, point_sigma))),
        query(BuildMap(passes.second, Options(kSecondScale, 2, point_sigma))),
        candidate_id(passes.first.views[kCandidate].data->id),
        query_id(passes.second.views[kQuery].data->id),
        truth(TrueSimilarity(passes.second.views[kQuery], kSecondScale, passes.first.views[kCandidate], kFirstScale)) {}

  static MapBuilderOptions Options(double scale, uint32_t number, double point_sigma) {
    MapBuilderOptions options;
    options.map = MapId(0, number, 1);
    options.map_from_world = Sim3d(scale, ExpSO3({0.1 * number, 0.2, -0.3}), {1.0 * number, 2, 3});
    options.point_sigma = point_sigma * scale;
    options.seed = number;
    return options;
  }
  Result<VerifiedPlace> Verify(const Sim3VerificationOptions& options = {}) const {
    return VerifyPlace(query, query_id, candidate, candidate_id, options);
  }

  Map candidate, query;
  KeyFrameId candidate_id, query_id;
  Sim3d truth;
};

std::string ReasonOf(const Result<VerifiedPlace>& result) {
  return result.ok() ? "verified: " + ToString(result->evidence) : result.error().message;
}

TEST(VerifyPlaceTest, FindsTheSimilarityBetweenTwoMaps) {
  const TwoMaps maps(MakeTwoPasses(SceneOptions()));
  const auto place = maps.Verify();
  ASSERT_TRUE(place.ok()) << ReasonOf(place);
  EXPECT_THAT(place->query_from_candidate, Sim3Near(maps.truth, PoseTolerance{1e-4, 1e-4}, 1e-4));
  EXPECT_GT(place->inliers, 200);
  EXPECT_GT(place->group_inliers, 200);
  EXPECT_EQ(place->inliers, static_cast<int>(place->matches.size()));
}

TEST(VerifyPlaceTest, MatchesAreOfOneLandmarkAndSeenIsTheirSuperset) {
  const TwoPasses passes = MakeTwoPasses(SceneOptions());
  const TwoMaps maps(passes);
  const auto place = maps.Verify();
  ASSERT_TRUE(place.ok()) << ReasonOf(place);
  int wrong = 0;
  for (const auto& [query, candidate] : place->matches) wrong += query.sequence() != candidate.sequence() ? 1 : 0;
  EXPECT_EQ(wrong, 0);
  const SyntheticView& view = passes.second.views[kQuery];
  std::set<uint32_t> features;
  std::set<MapPointId> landmarks;
  for (const auto& [feature, landmark] : place->seen) {
    EXPECT_TRUE(features.insert(feature).second && landmarks.insert(landmark).second) << "not one to one";
    EXPECT_EQ(landmark, PointOfLandmark(passes.first, view.landmark_of_feature[feature]));
  }
  for (const auto& [query, candidate] : place->matches) EXPECT_EQ(landmarks.count(candidate), 1u);
  EXPECT_GE(place->seen.size(), place->matches.size());
}

TEST(VerifyPlaceTest, FindsALoopWithScaleDriftInOneMap) {
  const TwoPasses passes = MakeTwoPasses(SceneOptions());
  Map map = BuildMap(passes.first);
  const double drift = 1.3;
  AddPass(passes.second, Sim3d(drift, ExpSO3({0.05, -0.1, 0.02}), {0.5, -0.2, 0.3}), &map);
  for (const size_t query : {0, 5, 9}) {
    const auto place =
        VerifyPlace(map, passes.second.views[query].data->id, map, passes.first.views[kCandidate].data->id, {});
    ASSERT_TRUE(place.ok()) << ReasonOf(place);
    const Sim3d truth = TrueSimilarity(passes.second.views[query], drift, passes.first.views[kCandidate], 1);
    EXPECT_THAT(place->query_from_candidate, Sim3Near(truth, PoseTolerance{1e-4, 1e-4}, 1e-4));
  }
}

TEST(VerifyPlaceTest, NoiseLeavesAnErrorOfItsSize) {
  // Landmarks are off by 0.02 of 5 units to each side, more than the pixels (0.5 of 500 on the lowest level): each of
  // 200 tells a direction to 4 mrad, and the scale, over views 0.25 rad apart, to 2 %. That is 0.3 mrad and 0.15 %
  // together; 6 times as much is allowed.
  SyntheticSceneOptions options = SceneOptions();
  options.pixel_sigma_px = 0.5;
  const TwoMaps maps(MakeTwoPasses(options), 0.02);
  const auto place = maps.Verify();
  ASSERT_TRUE(place.ok()) << ReasonOf(place);
  EXPECT_THAT(place->query_from_candidate, Sim3Near(maps.truth, PoseTolerance{0.002, 0.01 * kSecondScale}, 0.01));
}

TEST(VerifyPlaceTest, HalfOfTheMatchesMayBeWrong) {
  // On the second pass every second landmark looks like another of them.
  const std::vector<Descriptor> looks = MakeSyntheticScene(SceneOptions()).descriptors;
  const TwoMaps maps(MakeTwoPasses(SceneOptions(), [&](int landmark, const Descriptor& own) {
    return landmark % 2 == 0 ? own : looks[static_cast<size_t>(landmark + 100) % looks.size()];
  }));
  const auto place = maps.Verify();
  ASSERT_TRUE(place.ok()) << ReasonOf(place);
  EXPECT_THAT(place->query_from_candidate, Sim3Near(maps.truth, PoseTolerance{1e-3, 1e-3}, 1e-3));
  int wrong = 0;
  for (const auto& [query, candidate] : place->matches) wrong += query.sequence() != candidate.sequence() ? 1 : 0;
  EXPECT_LE(wrong, 2);
}

TEST(VerifyPlaceTest, AFixedScaleStaysOne) {
  const TwoPasses passes = MakeTwoPasses(SceneOptions());
  Map map = BuildMap(passes.first);
  AddPass(passes.second, Sim3d(1, ExpSO3({0.05, -0.1, 0.02}), {0.5, -0.2, 0.3}), &map);
  Sim3VerificationOptions options;
  options.fix_scale = true;
  const auto place =
      VerifyPlace(map, passes.second.views[kQuery].data->id, map, passes.first.views[kCandidate].data->id, options);
  ASSERT_TRUE(place.ok()) << ReasonOf(place);
  EXPECT_EQ(place->query_from_candidate.scale, 1);
}

TEST(VerifyPlaceTest, IsTheSameForTheSameSeed) {
  SyntheticSceneOptions options = SceneOptions();
  options.pixel_sigma_px = 0.5;
  const TwoMaps maps(MakeTwoPasses(options), 0.02);
  const auto first = maps.Verify(), second = maps.Verify();
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_EQ(first->query_from_candidate.translation, second->query_from_candidate.translation);
  EXPECT_EQ(first->query_from_candidate.scale, second->query_from_candidate.scale);
  EXPECT_EQ(first->matches, second->matches);
  EXPECT_EQ(first->seen, second->seen);
}

TEST(VerifyPlaceTest, APlaneIsNoObstacle) {
  SyntheticSceneOptions options = SceneOptions();
  options.landmarks = LandmarkLayout::kPlanar;
  const TwoMaps maps(MakeTwoPasses(options));
  const auto place = maps.Verify();
  ASSERT_TRUE(place.ok()) << ReasonOf(place);
  EXPECT_THAT(place->query_from_candidate, Sim3Near(maps.truth, PoseTolerance{1e-4, 1e-4}, 1e-4));
}

TEST(VerifyPlaceTest, FewLandmarksAreRefused) {
  SyntheticSceneOptions options = SceneOptions();
  options.num_landmarks = 12;
  const auto place = TwoMaps(MakeTwoPasses(options)).Verify();
  EXPECT_THAT(ReasonOf(place), HasSubstr("landmarks matched by words, expected 20"));
}

TEST(VerifyPlaceTest, ALineOfLandmarksIsRefused) {
  TwoMaps maps(MakeTwoPasses(SceneOptions()));
  for (Map* map : {&maps.candidate, &maps.query}) {
    const double scale = map == &maps.candidate ? kFirstScale : kSecondScale;
    for (const MapPointId id : map->SortedPointIds()) {
      const float along = static_cast<float>(0.01 * scale * id.sequence());
      map->SetPosition(id, Eigen::Vector3f(along, 2 * along, 3 * along));
    }
    map->RefreshDerived();
  }
  EXPECT_THAT(ReasonOf(maps.Verify()), HasSubstr("RANSAC: 0 inliers"));
}

TEST(VerifyPlaceTest, KeyFramesWithoutWordsAreRefused) {
  TwoPasses passes = MakeTwoPasses(SceneOptions());
  for (SyntheticView& view : passes.second.views) {
    KeyFrameData data = *view.data;
    data.nodes = NodeFeatures();
    view.data = std::make_shared<const KeyFrameData>(std::move(data));
  }
  EXPECT_THAT(ReasonOf(TwoMaps(passes).Verify()), HasSubstr("0 landmarks matched by words"));
}

TEST(VerifyPlaceTest, AnotherPlaceIsRefused) {
  Random random(7);
  const auto place = TwoMaps(MakeTwoPasses(SceneOptions(), [&](int, const Descriptor&) {
                       return RandomDescriptor(&random);
                     })).Verify();
  EXPECT_THAT(ReasonOf(place), HasSubstr("landmarks matched by words, expected"));
}

/// A descriptor of its own for each landmark for which it holds.
Appearance DifferentWhere(const std::function<bool(int)>& is_different) {
  return [is_different](int landmark, const Descriptor& own) {
    if (!is_different(landmark)) return own;
    Random random(1000 + static_cast<uint64_t>(landmark));
    return RandomDescriptor(&random);
  };
}

TEST(VerifyPlaceTest, ALookAlikeIsToldByWhatIsMissing) {
  // Every fifth landmark is the same, at the same place, as with equal doors in a corridor: 80 matches in full
  // agreement.
  const auto place = TwoMaps(MakeTwoPasses(SceneOptions(), DifferentWhere([](int i) { return i % 5 != 0; }))).Verify();
  EXPECT_THAT(ReasonOf(place), HasSubstr("% of what should be in view found"));
}

TEST(VerifyPlaceTest, ALookAlikePartInOneCornerIsRefused) {
  const std::vector<Eigen::Vector3d> landmarks = MakeSyntheticScene(SceneOptions()).landmarks_in_world;
  const auto is_outside = [&](int i) {
    const Eigen::Vector3d& p = landmarks[static_cast<size_t>(i)];
    return p.x() / p.z() < 0.1 || p.y() / p.z() < 0.05;
  };
  Sim3VerificationOptions options;
  options.min_share = 0;
  options.min_spread = 0.3;
  const auto place = TwoMaps(MakeTwoPasses(SceneOptions(), DifferentWhere(is_outside))).Verify(options);
  EXPECT_THAT(ReasonOf(place), HasSubstr("% of the image, expected 30 %"));
}

TEST(VerifyPlaceTest, LandmarksCountLittleWhereMuchIsMissing) {
  // The left half of the place is the same: more than enough matches and share, but half of the cells contradict.
  const std::vector<Eigen::Vector3d> landmarks = MakeSyntheticScene(SceneOptions()).landmarks_in_world;
  const auto is_right = [&](int i) { return landmarks[static_cast<size_t>(i)].x() > 0; };
  Sim3VerificationOptions options;
  options.min_weight = 60;
  const auto place = TwoMaps(MakeTwoPasses(SceneOptions(), DifferentWhere(is_right))).Verify(options);
  EXPECT_THAT(ReasonOf(place), HasSubstr(", expected 60: "));
  const auto whole = TwoMaps(MakeTwoPasses(SceneOptions())).Verify(options);
  ASSERT_TRUE(whole.ok()) << ReasonOf(whole);
  EXPECT_GT(whole->evidence.Weight(), 0.5 * whole->group_inliers);
}

TEST(VerifyPlaceTest, ALookAlikeSeenByOneKeyFrameAloneIsRefused) {
  TwoPasses passes = MakeTwoPasses(SceneOptions());
  Random random(3);
  for (size_t i = 0; i < passes.second.views.size(); ++i) {
    if (i == kQuery) continue;
    KeyFrameData data = *passes.second.views[i].data;
    for (Descriptor& descriptor : data.features.descriptors) descriptor = RandomDescriptor(&random);
    passes.second.views[i].data = std::make_shared<const KeyFrameData>(std::move(data));
  }
  EXPECT_THAT(ReasonOf(TwoMaps(passes).Verify()), HasSubstr("0 of 5 covisible keyframes agree"));
}

TEST(VerifyPlaceTest, WhatBothSidesSeeIsNoEvidence) {
  const TwoPasses passes = MakeTwoPasses(SceneOptions());
  const Map map = BuildMap(passes.first);
  const auto place = VerifyPlace(map, passes.first.views[8].data->id, map, passes.first.views[1].data->id, {});
  EXPECT_THAT(ReasonOf(place), HasSubstr("0 landmarks matched by words"));
}

TEST(VerifyPlaceTest, StopsWhenToldTo) {
  const TwoMaps maps(MakeTwoPasses(SceneOptions()));
  const std::atomic<bool> stop{true};
  StageTimes times;
  const auto place = VerifyPlace(maps.query, maps.query_id, maps.candidate, maps.candidate_id, {}, &stop, &times);
  EXPECT_EQ(ReasonOf(place), "stopped");
  EXPECT_EQ(times.samples().count("verify_words"), 0u);
}

TEST(VerifyPlaceTest, TellsTheTimesOfItsSteps) {
  const TwoMaps maps(MakeTwoPasses(SceneOptions()));
  StageTimes times;
  ASSERT_TRUE(VerifyPlace(maps.query, maps.query_id, maps.candidate, maps.candidate_id, {}, nullptr, &times).ok());
  for (const char* step : {"verify_words", "verify_ransac", "verify_refine", "verify_wide", "verify_neighbours"}) {
    EXPECT_EQ(times.samples().count(step), 1u) << step;
  }
}

}  // namespace
}  // namespace portolan
