#include "tracking/coarse_to_fine.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

constexpr size_t kFrameView = 5;

/// Views but the last make the map; the frame is view kFrameView seen anew: it is not in the map.
struct Setting {
  SyntheticScene scene;
  Map map;
  std::vector<ReferenceLandmark> reference;
  Rigid3d truth;

  explicit Setting(SyntheticSceneOptions options) {
    options.num_views = kFrameView + 1;
    options.num_landmarks = 600;
    options.travel = 1.0;
    scene = MakeSyntheticScene(options);
    MapBuilderOptions builder;
    builder.num_keyframes = kFrameView;
    map = BuildMap(scene, builder);
    static_cast<void>(map.TakeDelta());
    const KeyFrame& last = map.keyframe(scene.views[kFrameView - 1].data->id);
    // Every third landmark of the last keyframe: the fine stage has the others to find.
    std::vector<MapPointId> some = last.landmarks.ByFeature();
    for (size_t i = 0; i < some.size(); ++i) {
      if (i % 3 != 0) some[i] = MapPointId();
    }
    reference = ReferenceLandmarks(map, *last.data, some);
    truth = scene.views[kFrameView].camera_from_world;
  }
  /// Some 10 pixels off.
  Rigid3d Prediction() const { return Rigid3d(ExpSO3({0.012, -0.015, 0.01}), {0.03, -0.02, 0.03}) * truth; }
};

double RotationError(const Frame& frame, const Setting& s) {
  return frame.camera_from_map.rotation.angularDistance(s.truth.rotation);
}
double CentreError(const Frame& frame, const Setting& s) {
  return (frame.camera_from_map.TargetOriginInSource() - s.truth.TargetOriginInSource()).norm();
}

TEST(CoarseToFine, FindsTheExactPose) {
  const Setting s({});
  ASSERT_GT(s.reference.size(), 50u);
  MapTracker tracker{MapTrackingOptions()};
  Frame frame = FrameOfView(s.scene, kFrameView);
  const int coarse = tracker.TrackCoarse(s.map, s.reference, s.Prediction(), 30, &frame);
  EXPECT_GT(coarse, 0.8 * static_cast<double>(s.reference.size()));
  EXPECT_LT(RotationError(frame, s), 1e-5);
  const int fine = tracker.TrackFine(s.map, &frame);
  EXPECT_GT(fine, 2 * coarse);
  EXPECT_EQ(fine, frame.num_inliers);
  EXPECT_LE(frame.num_inliers, frame.num_candidates);
  EXPECT_LT(RotationError(frame, s), 1e-5);  // positions are floats, pixels too
  EXPECT_LT(CentreError(frame, s), 1e-4);
  EXPECT_EQ(CountWrongLandmarks(s.scene, kFrameView, s.map, frame.landmarks), 0);
  EXPECT_EQ(frame.reference, s.scene.views[kFrameView - 1].data->id);
}

TEST(CoarseToFine, NoiseOutliersAndClutterLeaveThePoseWithinItsSigma) {
  SyntheticSceneOptions options;
  options.pixel_sigma_px = 0.5;
  options.outlier_ratio = 0.1;
  options.descriptor_flip_ratio = 0.05;
  options.num_clutter = 500;
  const Setting s(options);
  MapTracker tracker{MapTrackingOptions()};
  Frame frame = FrameOfView(s.scene, kFrameView);
  EXPECT_GE(tracker.TrackCoarse(s.map, s.reference, s.Prediction(), 30, &frame), 40);
  const int fine = tracker.TrackFine(s.map, &frame);
  ASSERT_GT(fine, 150);
  // Features of up to 0.5 * 1.2^7 = 1.8 px at f = 500: with 150 of them 3e-4 rad, and 5 units of depth times that; a
  // factor 4 of safety.
  EXPECT_LT(RotationError(frame, s), 1.2e-3);
  EXPECT_LT(CentreError(frame, s), 6e-3);
  EXPECT_LT(CountWrongLandmarks(s.scene, kFrameView, s.map, frame.landmarks), 0.03 * fine);
}

TEST(CoarseToFine, WhereTheWindowsDoNotReachWiderOnesDo) {
  SyntheticSceneOptions options;
  options.pixel_sigma_px = 0.5;
  options.num_clutter = 1500;
  const Setting s(options);
  const MapTrackingOptions tracking;
  MapTracker tracker{tracking};
  Frame frame = FrameOfView(s.scene, kFrameView);
  const Rigid3d far = Rigid3d(ExpSO3({0.03, -0.07, 0}), Eigen::Vector3d::Zero()) * s.truth;  // some 38 px off
  const auto most = static_cast<int>(s.reference.size());
  EXPECT_LT(tracker.TrackCoarse(s.map, s.reference, far, tracking.coarse_radius_px, &frame), most / 4);
  EXPECT_GT(tracker.TrackCoarse(s.map, s.reference, {far}, &frame), most / 2);
  EXPECT_LT(RotationError(frame, s), 3e-3);
}

TEST(CoarseToFine, TheBestOfSeveralPredictionsIsTaken) {
  const Setting s({});
  MapTracker tracker{MapTrackingOptions()};
  const Rigid3d away(ExpSO3({0, M_PI, 0}) * s.truth.rotation, s.truth.translation);
  for (const std::vector<Rigid3d>& predictions : {std::vector<Rigid3d>{away, s.Prediction()}, {s.Prediction(), away}}) {
    Frame frame = FrameOfView(s.scene, kFrameView);
    const int inliers = tracker.TrackCoarse(s.map, s.reference, predictions, &frame);
    EXPECT_GT(inliers, 0.8 * static_cast<double>(s.reference.size()));
    EXPECT_EQ(inliers, frame.num_inliers);
    EXPECT_LT(RotationError(frame, s), 1e-5);
  }
}

TEST(CoarseToFine, NoMatchLeavesThePrediction) {
  const Setting s({});
  MapTracker tracker{MapTrackingOptions()};
  Frame frame = FrameOfView(s.scene, kFrameView);
  const Rigid3d away(ExpSO3({0, M_PI, 0}) * s.truth.rotation, s.truth.translation);  // looks the other way
  EXPECT_EQ(tracker.TrackCoarse(s.map, s.reference, away, 30, &frame), 0);
  EXPECT_LT(frame.camera_from_map.rotation.angularDistance(away.rotation), 1e-12);
  EXPECT_EQ(frame.num_inliers, 0);
  EXPECT_EQ(frame.Quality(), 0);
  EXPECT_EQ(tracker.TrackFine(s.map, &frame), 0);
}

TEST(CoarseToFine, AFeatureIsGivenToOneLandmarkAndALandmarkToOneFeature) {
  SyntheticSceneOptions options;
  options.pixel_sigma_px = 1;
  options.num_clutter = 300;
  const Setting s(options);
  MapTracker tracker{MapTrackingOptions()};
  Frame frame = FrameOfView(s.scene, kFrameView);
  tracker.TrackCoarse(s.map, s.reference, s.Prediction(), 30, &frame);
  tracker.TrackFine(s.map, &frame);
  std::set<MapPointId> seen;
  for (const MapPointId id : frame.landmarks) {
    if (!id.IsValid()) continue;
    EXPECT_TRUE(seen.insert(id).second) << id;
  }
}

TEST(OptimizeFramePose, TakesOutliersAndVanishedLandmarksOut) {
  const Setting s({});
  Frame frame = FrameOfView(s.scene, kFrameView);
  frame.camera_from_map = s.Prediction();
  frame.landmarks = TrueLandmarks(s.scene, kFrameView, s.map);
  size_t first = 0;
  while (!frame.landmarks[first].IsValid()) ++first;
  size_t second = first + 1;
  while (!frame.landmarks[second].IsValid() ||
         (frame.data->features.pixels_px[second] - frame.data->features.pixels_px[first]).norm() < 50) {
    ++second;
  }
  std::swap(frame.landmarks[first], frame.landmarks[second]);  // two wrong ones
  size_t third = second + 1;
  while (!frame.landmarks[third].IsValid()) ++third;
  frame.landmarks[third] = MapPointId(0, 9, 9);  // not in the map
  const int before = static_cast<int>(
      std::count_if(frame.landmarks.begin(), frame.landmarks.end(), [](MapPointId id) { return id.IsValid(); }));
  const int inliers = OptimizeFramePose(s.map, &frame);
  EXPECT_EQ(frame.num_candidates, before - 1);
  EXPECT_EQ(inliers, before - 3);
  EXPECT_FALSE(frame.landmarks[first].IsValid() || frame.landmarks[second].IsValid() ||
               frame.landmarks[third].IsValid());
  EXPECT_LT(RotationError(frame, s), 1e-5);
}

TEST(IsFound, ByNumberAndShareOfInliers) {
  TrackerOptions options;
  options.min_tracked_points = 20;
  options.min_tracked_quality = 0.3;
  options.keyframe.sure_points = 100;
  const auto is_found = [&](int inliers, int candidates) {
    Frame frame;
    frame.num_inliers = inliers;
    frame.num_candidates = candidates;
    return IsFound(frame, options);
  };
  EXPECT_TRUE(is_found(20, 60));
  EXPECT_FALSE(is_found(19, 19));
  EXPECT_FALSE(is_found(29, 175));  // leaves of a plant, a picture away from where they were mapped
  EXPECT_TRUE(is_found(100, 500));
  EXPECT_FALSE(is_found(0, 0));
}

TEST(ReferenceLandmarks, LeavesOutWhatIsNoLandmarkOrGone) {
  const Setting s({});
  std::vector<MapPointId> landmarks = TrueLandmarks(s.scene, 0, s.map);
  const auto all = ReferenceLandmarks(s.map, *s.scene.views[0].data, landmarks);
  size_t first = 0;
  while (!landmarks[first].IsValid()) ++first;
  EXPECT_EQ(all[0].id, landmarks[first]);
  EXPECT_EQ(all[0].descriptor, s.scene.views[0].data->features.descriptors[first]);
  EXPECT_EQ(all[0].octave, s.scene.views[0].data->features.octaves[first]);
  landmarks[first] = MapPointId(0, 9, 9);
  EXPECT_EQ(ReferenceLandmarks(s.map, *s.scene.views[0].data, landmarks).size() + 1, all.size());
}

}  // namespace
}  // namespace portolan
