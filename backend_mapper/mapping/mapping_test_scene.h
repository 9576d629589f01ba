#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/random.h"
#include "map/map.h"
#include "map/protocol.h"

namespace portolan {

struct TestSceneOptions {
  int num_points = 600;
  bool planar = false;     ///< all points on a slanted plane
  double pixel_sigma = 0;  ///< noise of a feature at octave 0, pixels; grows with the octave's scale
  int flipped_bits = 0;    ///< of each feature's descriptor, against its point's
  int clutter = 0;         ///< features of no point, in each view
  uint64_t seed = 1;
};

/// What a camera sees of the scene.
struct TestView {
  std::shared_ptr<const KeyFrameData> data;
  Rigid3d camera_from_map;  ///< true pose
  std::vector<int> points;  ///< true point of each feature, -1 for clutter
};

/// Points with known positions and descriptors in front of cameras with known poses: exact features without images, for
/// the mapper's tests. The world frame is the true map frame. Points lie 4 to 10 units ahead of the origin, along +z.
/// Deterministic for a seed.
class TestScene {
 public:
  explicit TestScene(const TestSceneOptions& options = {});

  /// The features of a camera, one for each point in its image. Views are numbered 1, 2, ... in order of the calls, 0.1
  /// s apart.
  TestView See(const Rigid3d& camera_from_map);

  const std::vector<Eigen::Vector3d>& points_in_map() const { return points_in_map_; }
  const PinholeCamera& camera() const { return camera_; }

 private:
  TestSceneOptions options_;
  Random random_;
  PinholeCamera camera_;
  std::vector<Eigen::Vector3d> points_in_map_;
  std::vector<Descriptor> descriptors_;
  uint32_t views_ = 0;
};

/// A camera at `centre_in_map` that looks along +z, turned by a rotation vector.
Rigid3d CameraAt(const Eigen::Vector3d& centre_in_map, const Eigen::Vector3d& turn = Eigen::Vector3d::Zero());

/// Views along a path to the right (+x) with slight turns, `step` apart.
std::vector<TestView> SeeAlongPath(TestScene* scene, int count, double step);

/// Id that BuildTrueMap gives to a point of the scene.
MapPointId TruePointId(int point);

/// The true map of some views, of every `every`-th point seen by at least two of them: a chain of keyframes, the first
/// of which is the root.
Map BuildTrueMap(const TestScene& scene, const std::vector<TestView>& views, int every = 1);

/// (feature of first, feature of second) of all points that both see.
std::vector<std::pair<uint32_t, uint32_t>> TrueMatches(const TestView& first, const TestView& second);

/// The message of a tracker that found every landmark of the map which the view sees. Map and scene must be in the same
/// frame.
KeyFrameMessage TrackedMessage(const Map& map, const TestView& view, const std::vector<TestView>& earlier);

/// The scene's point that a landmark stands for, by its first observation; -1 for clutter.
int TruePointOf(const MapPoint& point, const std::vector<TestView>& views);

}  // namespace portolan
