#include "testing/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/check.h"

namespace portolan {
namespace {

constexpr double kNearPlane = 0.02;  // metres: nothing comes closer to the lens
constexpr int kMostTaps = 4;         // of a footprint longer than wide

// The rotated grid: four samples a pixel which differ in every row and every column. Pixels from the centre.
constexpr std::array<std::array<double, 2>, 4> kSampleOffsets = {
    {{-0.125, -0.375}, {0.375, -0.125}, {0.125, 0.375}, {-0.375, 0.125}}};

/// Cuts a polygon with the half space z >= kNearPlane (Sutherland and Hodgman 1974).
std::vector<Eigen::Vector3d> ClipNear(const std::array<Eigen::Vector3d, 4>& corners) {
  std::vector<Eigen::Vector3d> clipped;
  for (size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector3d& a = corners[i];
    const Eigen::Vector3d& b = corners[(i + 1) % corners.size()];
    const bool a_inside = a.z() >= kNearPlane, b_inside = b.z() >= kNearPlane;
    if (a_inside) clipped.push_back(a);
    if (a_inside != b_inside) clipped.push_back(a + (kNearPlane - a.z()) / (b.z() - a.z()) * (b - a));
  }
  return clipped;
}

bool OutsideImage(const std::vector<Eigen::Vector2d>& outline, const PinholeCamera& camera) {
  Eigen::Vector2d low = outline[0], high = outline[0];
  for (const Eigen::Vector2d& p : outline) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  return high.x() < -1 || high.y() < -1 || low.x() > camera.width || low.y() > camera.height;
}

/// Grey of the sky in a direction: brighter towards the horizon. Smooth, so that it gives no features.
float SkyGrey(const Eigen::Vector3d& direction_in_world) {
  constexpr float kHorizonGrey = 225.0f, kZenithGrey = 165.0f;
  const double up = std::max(0.0, direction_in_world.z() / direction_in_world.norm());
  return kHorizonGrey + (kZenithGrey - kHorizonGrey) * static_cast<float>(up);
}

}  // namespace

Renderer::Renderer(const SyntheticWorld& world, const PinholeCamera& camera) : world_(world), camera_(camera) {
  PORTOLAN_CHECK(camera.width > 0 && camera.height > 0 && camera.fx > 0 && camera.fy > 0)
      << " a camera without size or focal length";
  const size_t pixels = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  for (int s = 0; s < kSamples; ++s) {
    inverse_z_[s].resize(pixels);
    surface_[s].resize(pixels);
  }
}

bool Renderer::Project(const TexturedQuad& quad, const Rigid3d& camera_from_world, ScreenQuad* out) const {
  const Eigen::Vector3d corner = camera_from_world * quad.corner_in_world;
  const Eigen::Vector3d edge_u = camera_from_world.rotation * quad.edge_u;
  const Eigen::Vector3d edge_v = camera_from_world.rotation * quad.edge_v;
  const Eigen::Vector3d away = edge_u.cross(edge_v);
  const double offset = away.dot(corner);
  if (offset <= 0) return false;  // seen from behind
  const std::vector<Eigen::Vector3d> clipped =
      ClipNear({corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v});
  if (clipped.size() < 3) return false;
  out->outline_px.clear();
  out->nearest_z = clipped[0].z();
  for (const Eigen::Vector3d& point : clipped) {
    out->outline_px.push_back(camera_.Project(point));
    out->nearest_z = std::min(out->nearest_z, point.z());
  }
  if (OutsideImage(out->outline_px, camera_)) return false;
  // On the plane, away . X = offset with X = z * ray, so 1/z = away . ray / offset; and the share along edge_u is
  // edge_u . (X - corner) / |edge_u|^2, which over z is linear in the ray too. ray = K^-1 (x, y, 1).
  Eigen::Matrix3d ray_from_pixel;
  ray_from_pixel << 1 / camera_.fx, 0, -camera_.cx / camera_.fx, 0, 1 / camera_.fy, -camera_.cy / camera_.fy, 0, 0, 1;
  const Eigen::Vector3d inverse_z = away / offset;
  const auto over_z = [&](const Eigen::Vector3d& edge, double uv_corner, double uv_size) -> Eigen::Vector3d {
    const Eigen::Vector3d unit = uv_size * edge / edge.squaredNorm();
    return ray_from_pixel.transpose() * (unit + (uv_corner - unit.dot(corner)) * inverse_z);
  };
  out->inverse_z = ray_from_pixel.transpose() * inverse_z;
  out->u_over_z = over_z(edge_u, quad.uv_corner.x(), quad.uv_size.x());
  out->v_over_z = over_z(edge_v, quad.uv_corner.y(), quad.uv_size.y());
  out->texture = &world_.textures[static_cast<size_t>(quad.texture)];
  out->shade = quad.shade;
  return true;
}

void Renderer::Rasterize(const ScreenQuad& quad, int32_t index, int sample) {
  const auto [offset_x, offset_y] = kSampleOffsets[static_cast<size_t>(sample)];
  double top = quad.outline_px[0].y(), bottom = top;
  for (const Eigen::Vector2d& p : quad.outline_px) {
    top = std::min(top, p.y());
    bottom = std::max(bottom, p.y());
  }
  const int first_row = static_cast<int>(std::clamp(std::ceil(top - offset_y), 0.0, double(camera_.height)));
  const int last_row = static_cast<int>(std::clamp(std::floor(bottom - offset_y), -1.0, double(camera_.height - 1)));
  const size_t n = quad.outline_px.size();
  for (int row = first_row; row <= last_row; ++row) {
    const double y = row + offset_y;
    double left = INFINITY, right = -INFINITY;  // the convex outline meets the row of samples in one span
    for (size_t i = 0; i < n; ++i) {
      const Eigen::Vector2d& a = quad.outline_px[i];
      const Eigen::Vector2d& b = quad.outline_px[(i + 1) % n];
      if ((a.y() < y) == (b.y() < y)) continue;
      const double x = a.x() + (y - a.y()) / (b.y() - a.y()) * (b.x() - a.x());
      left = std::min(left, x);
      right = std::max(right, x);
    }
    if (!(left <= right)) continue;
    const int begin = static_cast<int>(std::clamp(std::ceil(left - offset_x), 0.0, double(camera_.width)));
    const int end = static_cast<int>(std::clamp(std::ceil(right - offset_x), 0.0, double(camera_.width)));
    const size_t row_start = static_cast<size_t>(row) * static_cast<size_t>(camera_.width);
    float* depth = &inverse_z_[sample][row_start];
    int32_t* surface = &surface_[sample][row_start];
    const float base = static_cast<float>(quad.inverse_z.x() * offset_x + quad.inverse_z.y() * y + quad.inverse_z.z());
    const float step = static_cast<float>(quad.inverse_z.x());
    for (int x = begin; x < end; ++x) {
      const float inverse_z = base + step * static_cast<float>(x);
      const bool nearer = inverse_z > depth[x];
      depth[x] = nearer ? inverse_z : depth[x];
      surface[x] = nearer ? index : surface[x];
    }
  }
}

float Renderer::ShadeQuad(const ScreenQuad& quad, double x_px, double y_px) const {
  const double z = 1.0 / (quad.inverse_z.x() * x_px + quad.inverse_z.y() * y_px + quad.inverse_z.z());
  const double u = z * (quad.u_over_z.x() * x_px + quad.u_over_z.y() * y_px + quad.u_over_z.z());
  const double v = z * (quad.v_over_z.x() * x_px + quad.v_over_z.y() * y_px + quad.v_over_z.z());
  // Derivatives of (u, v) by the pixel, in texels: the pixel's footprint on the texture (Heckbert, MSc thesis, 1989).
  const double width = quad.texture->width(), height = quad.texture->height();
  const Eigen::Vector2d by_x(width * z * (quad.u_over_z.x() - u * quad.inverse_z.x()),
                             height * z * (quad.v_over_z.x() - v * quad.inverse_z.x()));
  const Eigen::Vector2d by_y(width * z * (quad.u_over_z.y() - u * quad.inverse_z.y()),
                             height * z * (quad.v_over_z.y() - v * quad.inverse_z.y()));
  const double length_x = by_x.norm(), length_y = by_y.norm();
  const Eigen::Vector2d& longer = length_x > length_y ? by_x : by_y;
  const double longest = std::max(length_x, length_y), shortest = std::max(1e-9, std::min(length_x, length_y));
  const int taps = std::clamp(static_cast<int>(std::ceil(longest / shortest - 0.5)), 1, kMostTaps);
  const float level = static_cast<float>(std::log2(std::max(1.0, longest / taps)));
  float sum = 0;
  for (int i = 0; i < taps; ++i) {
    const double along = (i + 0.5) / taps - 0.5;
    sum += quad.texture->Sample(u + along * longer.x() / width, v + along * longer.y() / height, level);
  }
  return quad.shade * sum / static_cast<float>(taps);
}

float Renderer::ShadePixel(int x, int y, const Rigid3d& world_from_camera) const {
  const size_t pixel = static_cast<size_t>(y) * static_cast<size_t>(camera_.width) + static_cast<size_t>(x);
  float sum = 0;
  bool done[kSamples] = {};
  for (int s = 0; s < kSamples; ++s) {
    if (done[s]) continue;
    const int32_t surface = surface_[s][pixel];
    // Each surface is shaded once, at the centroid of its samples in the pixel: a place where it is seen.
    double offset_x = 0, offset_y = 0;
    int covered = 0;
    for (int t = s; t < kSamples; ++t) {
      if (surface_[t][pixel] != surface) continue;
      done[t] = true;
      ++covered;
      offset_x += kSampleOffsets[static_cast<size_t>(t)][0];
      offset_y += kSampleOffsets[static_cast<size_t>(t)][1];
    }
    const double at_x = x + offset_x / covered, at_y = y + offset_y / covered;
    const float grey = surface >= 0 ? ShadeQuad(visible_[static_cast<size_t>(surface)], at_x, at_y)
                                    : SkyGrey(world_from_camera.rotation * camera_.Unproject({at_x, at_y}));
    sum += static_cast<float>(covered) * grey;
  }
  return sum / kSamples;
}

cv::Mat Renderer::Render(const Rigid3d& world_from_camera) {
  const Rigid3d camera_from_world = world_from_camera.Inverse();
  visible_.clear();
  for (const TexturedQuad& quad : world_.quads) {
    ScreenQuad screen;
    if (Project(quad, camera_from_world, &screen)) visible_.push_back(std::move(screen));
  }
  std::stable_sort(visible_.begin(), visible_.end(),
                   [](const ScreenQuad& a, const ScreenQuad& b) { return a.nearest_z < b.nearest_z; });
  for (int s = 0; s < kSamples; ++s) {
    std::fill(inverse_z_[s].begin(), inverse_z_[s].end(), 0.0f);
    std::fill(surface_[s].begin(), surface_[s].end(), -1);
    for (size_t i = 0; i < visible_.size(); ++i) Rasterize(visible_[i], static_cast<int32_t>(i), s);
  }
  cv::Mat grey(camera_.height, camera_.width, CV_32FC1);
  for (int y = 0; y < camera_.height; ++y) {
    float* row = grey.ptr<float>(y);
    for (int x = 0; x < camera_.width; ++x) row[x] = ShadePixel(x, y, world_from_camera);
  }
  return grey;
}

}  // namespace portolan
