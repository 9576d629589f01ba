#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/time.h"
#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "testing/camera_path.h"
#include "testing/lens_warp.h"
#include "testing/renderer.h"
#include "testing/sensor.h"
#include "testing/synthetic_world.h"

namespace portolan {

/// How to film a synthetic place.
struct SequenceOptions {
  std::string scene = "town";  ///< one of SceneNames()
  int width = 640, height = 480;
  double fps = 20;
  int num_frames = 0;     ///< 0: as long as the scene's way takes
  double speed = 1.0;     ///< factor on the camera's speed
  uint64_t seed = 1;      ///< of the place and of the noise
  int texture_px = 1024;  ///< side of the larger pictures, a power of two; less paints faster and is blurrier close by
  bool repeat_facades = false;  ///< town, street: places that look alike
  RadialResidual lens;          ///< bends the pictures; camera() does not tell
  SensorOptions sensor;

  Status Check() const;  ///< names the option, its value and what was expected
};

/// The scenes, each with a line that describes it.
struct SceneDescription {
  std::string name, text;
};
const std::vector<SceneDescription>& SceneNames();

/// A frame's ground truth.
struct SyntheticFrame {
  Timestamp stamp;            ///< of the middle of the exposure
  double path_s = 0;          ///< time on the camera's path
  Rigid3d world_from_camera;  ///< exact
  bool black = false;         ///< the lens is covered
};

/// A camera's ideal intrinsics for pictures of a size: 62 degrees wide, principal point in the middle.
PinholeCamera MakeSyntheticCamera(int width, int height);

/// A place and a camera's way through it: every frame with its exact pose, rendered on demand.
///
///   Result<SyntheticSequence> sequence = SyntheticSequence::Make({"town"});
///   SequenceRenderer renderer(*sequence);
///   for (size_t i = 0; i < sequence->frames().size(); ++i) Use(renderer.Render(i),
///   sequence->frames()[i].world_from_camera);
class SyntheticSequence {
 public:
  /// Fails as SequenceOptions::Check.
  static Result<SyntheticSequence> Make(const SequenceOptions& options);

  const SequenceOptions& options() const { return options_; }
  const SyntheticWorld& world() const { return world_; }
  const PinholeCamera& camera() const { return camera_; }
  const CameraPath& path() const { return path_; }
  const std::vector<SyntheticFrame>& frames() const { return frames_; }

 private:
  SyntheticSequence(const SequenceOptions& options, SyntheticWorld world, CameraPath path)
      : options_(options), world_(std::move(world)), path_(std::move(path)) {}

  SequenceOptions options_;
  SyntheticWorld world_;
  CameraPath path_;
  PinholeCamera camera_;
  std::vector<SyntheticFrame> frames_;
};

/// Renders the frames of a sequence in any order: a frame's picture depends on its number and the options alone. One
/// object per thread.
class SequenceRenderer {
 public:
  /// @param sequence must outlive the renderer.
  explicit SequenceRenderer(const SyntheticSequence& sequence);

  /// @return CV_8UC1.
  cv::Mat Render(size_t frame);

 private:
  cv::Mat RenderLight(const SyntheticFrame& frame);
  cv::Mat RenderAt(const Rigid3d& world_from_camera);

  const SyntheticSequence& sequence_;
  std::optional<LensWarp> lens_;  // none: ideal pictures
  Renderer renderer_;
};

}  // namespace portolan
