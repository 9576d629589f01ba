#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "testing/synthetic_world.h"

namespace portolan {

/// Renders a world as an ideal pinhole camera sees it, with exact geometry: visibility at four samples a pixel with a
/// depth buffer, then each visible surface of a pixel shaded once from its mip levels (multisampling). CPU, one thread,
/// deterministic. Keeps its buffers between calls: one object per thread.
///
///   Renderer renderer(world, camera);
///   cv::Mat grey = renderer.Render(world_from_camera);
class Renderer {
 public:
  /// @param world must outlive the renderer.
  Renderer(const SyntheticWorld& world, const PinholeCamera& camera);

  /// @return CV_32FC1, grey values 0 to 255, without sensor noise (sensor.h adds it).
  cv::Mat Render(const Rigid3d& world_from_camera);

 private:
  static constexpr int kSamples = 4;

  /// A quad before one camera, as functions of the pixel (x, y, 1): 1/z, u/z and v/z are linear in it.
  struct ScreenQuad {
    Eigen::Vector3d inverse_z, u_over_z, v_over_z;
    double nearest_z = 0;  // of its corners, for the order of drawing
    std::vector<Eigen::Vector2d> outline_px;
    const Texture* texture = nullptr;
    float shade = 1.0f;
  };

  bool Project(const TexturedQuad& quad, const Rigid3d& camera_from_world, ScreenQuad* out) const;
  void Rasterize(const ScreenQuad& quad, int32_t index, int sample);
  float ShadePixel(int x, int y, const Rigid3d& world_from_camera) const;
  float ShadeQuad(const ScreenQuad& quad, double x_px, double y_px) const;

  const SyntheticWorld& world_;
  const PinholeCamera camera_;
  std::vector<ScreenQuad> visible_;         // of the frame, nearest first
  std::vector<float> inverse_z_[kSamples];  // height x width per sample: 1/z of what is seen, 0 for sky
  std::vector<int32_t> surface_[kSamples];  // index into visible_, -1 for sky
};

}  // namespace portolan
