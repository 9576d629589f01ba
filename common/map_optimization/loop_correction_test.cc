#include "map_optimization/loop_correction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "map_optimization/map_correction.h"
#include "testing/drifted_map.h"
#include "testing/matchers.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

constexpr size_t kCurrent = 109, kMatched = 9;  // at the same place, a lap apart

/// A street driven round once and a tenth, as a map whose scale and direction drifted.
class LoopCorrectionTest : public testing::Test {
 protected:
  void SetUp() override { Build(0.998, {0.0005, 0.001, 0.0002}, 0); }

  void Build(double scale_step, const Eigen::Vector3d& turn_step, double pixel_sigma) {
    SyntheticSceneOptions options;
    options.landmarks = LandmarkLayout::kStreet;
    options.motion = CameraMotion::kStreetLap;
    options.num_landmarks = 5000;
    options.num_views = 110;
    options.lap = 40;
    options.travel = 40 * 109 / 100.0;  // views 0.4 apart
    options.sight = 6;
    options.num_clutter = 50;
    options.descriptor_flip_ratio = 0.03;
    options.pixel_sigma_px = pixel_sigma;
    scene_ = MakeSyntheticScene(options);
    DriftOptions drift;
    drift.scale_step = scale_step;
    drift.turn_step = turn_step;
    drifted_ = BuildDriftedMap(scene_, drift);
    drifted_.map.TakeDelta();
    loop_.current = id(kCurrent);
    loop_.matched = id(kMatched);
    loop_.current_from_matched = drifted_.TrueSimilarity(scene_, kCurrent, kMatched);
    const KeyFrame& current = map().keyframe(loop_.current);
    for (const auto& [feature, point] : drifted_.TrueSightings(scene_, kCurrent, kMatched)) {
      loop_.seen.emplace_back(feature, point);
      if (current.landmarks[feature].IsValid()) loop_.merges.emplace_back(current.landmarks[feature], point);
    }
  }
  KeyFrameId id(size_t view) const { return scene_.views[view].data->id; }
  const Map& map() const { return drifted_.map; }
  Result<MapCorrection> Correct() { return CorrectLoop(map(), loop_, options_, nullptr, &times_); }
  /// The map as its owner has it after the correction.
  Map Corrected(const MapCorrection& correction) {
    Map corrected = map();
    EXPECT_TRUE(ApplyMapCorrection(correction, &corrected).ok());
    EXPECT_THAT(ValidateMap(corrected), IsEmpty());
    return corrected;
  }
  /// Reprojection errors of all observations, pixels, sorted.
  static std::vector<double> Errors(const Map& map) {
    std::vector<double> errors;
    for (const auto& [point_id, point] : map.points()) {
      for (const Observation& o : point.observations) {
        const KeyFrame& keyframe = map.keyframe(o.keyframe);
        const Eigen::Vector3d in_camera = keyframe.camera_from_map * point.position_in_map.cast<double>();
        errors.push_back(
            (keyframe.data->camera.Project(in_camera) - keyframe.data->features.pixels_px[o.feature].cast<double>())
                .norm());
      }
    }
    std::sort(errors.begin(), errors.end());
    return errors;
  }

  SyntheticScene scene_;
  DriftedMap drifted_;
  LoopClosure loop_;
  LoopCorrectionOptions options_;
  StageTimes times_;
};

TEST_F(LoopCorrectionTest, ClosesTheLap) {
  const MapError before = CompareWithScene(map(), scene_);
  const auto correction = Correct();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  const Map corrected = Corrected(*correction);
  const MapError after = CompareWithScene(corrected, scene_);
  EXPECT_LT(after.max_translation, 0.15 * before.max_translation);
  EXPECT_LT(after.max_rotation_rad, 0.5 * before.max_rotation_rad);
  EXPECT_LT(after.median_point, 0.2 * before.median_point);
  // The gap at the seam, in the map's own frame, is closed to a small part of what it was.
  const auto gap = [&](const Map& m) {
    return (m.keyframe(loop_.current).camera_from_map.TargetOriginInSource() -
            m.keyframe(loop_.matched).camera_from_map.TargetOriginInSource())
        .norm();
  };
  EXPECT_GT(gap(map()), 1.0);
  EXPECT_LT(gap(corrected), 0.05);
}

TEST_F(LoopCorrectionTest, SaysWhatItIsAndNamesEveryKeyFrame) {
  const auto correction = Correct();
  ASSERT_TRUE(correction.ok());
  EXPECT_EQ(correction->kind, "loop");
  EXPECT_EQ(correction->map, map().id());
  EXPECT_EQ(correction->epoch, map().epoch());
  EXPECT_EQ(correction->made_from_revision, map().revision());
  EXPECT_EQ(correction->keyframes.size(), map().keyframes().size());
  EXPECT_THAT(correction->loop_edges, testing::Contains(std::make_pair(loop_.current, loop_.matched)));
  for (const char* stage : {"loop_window", "loop_fusion", "loop_welding", "loop_graph"}) {
    EXPECT_EQ(times_.samples().count(stage), 1u) << stage;
  }
  const auto& root = correction->keyframes.front();
  EXPECT_THAT(MakeRigid(root.camera_from_map), RigidNear(map().keyframe(root.id).camera_from_map, PoseTolerance{}));
}

TEST_F(LoopCorrectionTest, BothSidesBecomeOneAndReprojectionsStaySmall) {
  const std::vector<double> before = Errors(map());
  const auto correction = Correct();
  ASSERT_TRUE(correction.ok());
  EXPECT_GT(correction->merges.size(), loop_.merges.size()) << "fusion finds more than verification did";
  const Map corrected = Corrected(*correction);
  EXPECT_GT(corrected.Covisibility(loop_.current, loop_.matched), static_cast<int>(loop_.seen.size()) / 2);
  EXPECT_GT(corrected.Covisibility(id(kCurrent - 3), loop_.matched), 30);
  const std::vector<double> after = Errors(corrected);
  EXPECT_LT(after[after.size() / 2], 1.2 * before[before.size() / 2] + 0.5);
  EXPECT_LT(after[after.size() * 95 / 100], 1.2 * before[before.size() * 95 / 100] + 2.0);
}

TEST_F(LoopCorrectionTest, MergedPointsShowOneLandmark) {
  const auto correction = Correct();
  ASSERT_TRUE(correction.ok());
  const Map corrected = Corrected(*correction);
  for (const auto& [from, into] : correction->merges) {
    const MapPoint* point = corrected.FindPoint(into);
    if (point == nullptr) continue;  // merged further
    std::set<int> landmarks;
    for (const Observation& o : point->observations) {
      landmarks.insert(scene_.views[scene_.ViewOf(o.keyframe)].landmark_of_feature[o.feature]);
    }
    EXPECT_EQ(landmarks.size(), 1u) << into;
  }
}

TEST_F(LoopCorrectionTest, NoDriftMeansNoMove) {
  Build(1.0, Eigen::Vector3d::Zero(), 0);
  const auto correction = Correct();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  EXPECT_THAT(Corrected(*correction), MapNear(scene_, MapTolerance{1e-3, 1e-3, 1e-2}));
}

TEST_F(LoopCorrectionTest, NoisyFeaturesCloseItToo) {
  Build(0.998, {0.0005, 0.001, 0.0002}, 0.4);
  const MapError before = CompareWithScene(map(), scene_);
  const auto correction = Correct();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  EXPECT_LT(CompareWithScene(Corrected(*correction), scene_).camera_rmse, 0.2 * before.camera_rmse);
}

TEST_F(LoopCorrectionTest, YoungerKeyFramesComeAlong) {
  // The snapshot was made before the last three keyframes.
  const auto correction = Correct();
  ASSERT_TRUE(correction.ok());
  MapCorrection older = *correction;
  older.keyframes.resize(older.keyframes.size() - 3);
  EXPECT_LT(CompareWithScene(Corrected(older), scene_).max_translation,
            0.2 * CompareWithScene(map(), scene_).max_translation);
}

TEST_F(LoopCorrectionTest, AWrongLoopIsRefused) {
  loop_.seen.clear();
  loop_.merges.clear();
  loop_.current_from_matched.translation.x() += 3;
  const auto correction = Correct();
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("expected at least"));
}

TEST_F(LoopCorrectionTest, RefusesWhatIsNoLoop) {
  const auto refuses = [&](const LoopClosure& loop, const std::string& because) {
    const auto correction = CorrectLoop(map(), loop, options_, nullptr, nullptr);
    ASSERT_FALSE(correction.ok()) << because;
    EXPECT_THAT(correction.error().message, HasSubstr(because));
  };
  LoopClosure loop = loop_;
  loop.current = KeyFrameId(9, 9, 9);
  refuses(loop, "is not in the map");
  loop = loop_;
  loop.matched = loop.current;
  refuses(loop, "one keyframe");
  loop = loop_;
  loop.current_from_matched.scale = 0;
  refuses(loop, "no similarity");
}

TEST_F(LoopCorrectionTest, StopEndsIt) {
  const std::atomic<bool> stop{true};
  const auto correction = CorrectLoop(map(), loop_, options_, &stop, nullptr);
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("interrupted"));
}

TEST_F(LoopCorrectionTest, LeavesItsInputAloneAndIsDeterministic) {
  const uint64_t hash = HashMap(map());
  const auto a = Correct(), b = Correct();
  EXPECT_EQ(HashMap(map()), hash);
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(HashMap(Corrected(*a)), HashMap(Corrected(*b)));
}

}  // namespace
}  // namespace portolan
