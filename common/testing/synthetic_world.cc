#include "testing/synthetic_world.h"

#include <Eigen/Geometry>
#include <cmath>

#include "base/check.h"

namespace portolan {
namespace {

constexpr float kAmbientLight = 0.72f;  // chosen by eye: faces away from the sun stay well above the noise
constexpr float kSunLight = 0.28f;

/// @param outward unit normal of a face towards its viewer.
float Shade(const Eigen::Vector3d& outward) {
  const Eigen::Vector3d to_sun = Eigen::Vector3d(0.4, 0.55, 0.73).normalized();
  return kAmbientLight + kSunLight * static_cast<float>(std::max(0.0, outward.dot(to_sun)));
}

}  // namespace

std::optional<WorldHit> CastRay(const SyntheticWorld& world, const Eigen::Vector3d& origin_in_world,
                                const Eigen::Vector3d& direction_in_world) {
  std::optional<WorldHit> nearest;
  for (size_t i = 0; i < world.quads.size(); ++i) {
    const TexturedQuad& quad = world.quads[i];
    const Eigen::Vector3d away = quad.edge_u.cross(quad.edge_v);
    const double slope = away.dot(direction_in_world);
    if (slope <= 0) continue;  // seen from behind, or edge on
    const double distance = away.dot(quad.corner_in_world - origin_in_world) / slope;
    if (distance <= 0 || (nearest && nearest->distance <= distance)) continue;
    const Eigen::Vector3d point = origin_in_world + distance * direction_in_world;
    const Eigen::Vector3d from_corner = point - quad.corner_in_world;
    const double a = from_corner.dot(quad.edge_u) / quad.edge_u.squaredNorm();
    const double b = from_corner.dot(quad.edge_v) / quad.edge_v.squaredNorm();
    if (a < 0 || a > 1 || b < 0 || b > 1) continue;
    nearest = WorldHit{static_cast<int>(i), distance, point};
  }
  return nearest;
}

int WorldBuilder::AddTexture(const cv::Mat& picture) {
  world_.textures.emplace_back(picture);
  return static_cast<int>(world_.textures.size()) - 1;
}

void WorldBuilder::AddQuad(const Eigen::Vector3d& corner, const Eigen::Vector3d& edge_u, const Eigen::Vector3d& edge_v,
                           const Cover& cover) {
  PORTOLAN_CHECK(std::abs(edge_u.dot(edge_v)) <= 1e-9 * edge_u.norm() * edge_v.norm())
      << " the edges of a quad are not square";
  TexturedQuad quad;
  quad.corner_in_world = corner;
  quad.edge_u = edge_u;
  quad.edge_v = edge_v;
  quad.texture = cover.texture;
  quad.uv_corner = cover.uv_corner;
  if (cover.metres > 0) quad.uv_size = Eigen::Vector2d(edge_u.norm(), edge_v.norm()) / cover.metres;
  quad.shade = Shade(-edge_u.cross(edge_v).normalized());
  world_.quads.push_back(quad);
}

void WorldBuilder::AddWall(const Eigen::Vector2d& left, const Eigen::Vector2d& right, double z_low, double z_high,
                           const Cover& cover) {
  const Eigen::Vector2d along = right - left;
  AddQuad({left.x(), left.y(), z_high}, {along.x(), along.y(), 0}, {0, 0, z_low - z_high}, cover);
}

void WorldBuilder::AddLevel(const Eigen::Vector2d& low, const Eigen::Vector2d& high, double z, const Cover& cover,
                            bool from_below) {
  const Eigen::Vector3d x(high.x() - low.x(), 0, 0), y(0, high.y() - low.y(), 0);
  if (from_below) {
    AddQuad({low.x(), low.y(), z}, x, y, cover);
  } else {
    AddQuad({low.x(), high.y(), z}, x, -y, cover);
  }
}

void WorldBuilder::AddBox(const Eigen::Vector2d& centre, const Eigen::Vector3d& size, double yaw, double z_low,
                          const Cover& sides, const Cover& top) {
  const Eigen::Rotation2Dd turn(yaw);
  const Eigen::Vector2d half_x = turn * Eigen::Vector2d(size.x() / 2, 0),
                        half_y = turn * Eigen::Vector2d(0, size.y() / 2);
  // Corners counter-clockwise from above: a viewer outside has each one on the left of the next.
  const Eigen::Vector2d corners[4] = {centre - half_x - half_y, centre + half_x - half_y, centre + half_x + half_y,
                                      centre - half_x + half_y};
  const double z_high = z_low + size.z();
  for (int i = 0; i < 4; ++i) {
    Cover cover = sides;
    cover.uv_corner.x() += 0.25 * i;  // another part of the picture on each side
    AddWall(corners[i], corners[(i + 1) % 4], z_low, z_high, cover);
  }
  const Eigen::Vector2d x = 2 * half_x, y = 2 * half_y;
  AddQuad({corners[3].x(), corners[3].y(), z_high}, {x.x(), x.y(), 0}, {-y.x(), -y.y(), 0}, top);
}

}  // namespace portolan
