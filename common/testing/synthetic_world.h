#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "testing/texture.h"

namespace portolan {

/// A textured rectangle in space, seen from one side only: point(a, b) = corner + a * edge_u + b * edge_v with a, b in
/// [0, 1]. From its visible side edge_u points right, edge_v down and edge_u x edge_v away from the viewer.
struct TexturedQuad {
  Eigen::Vector3d corner_in_world = Eigen::Vector3d::Zero();  ///< top left
  Eigen::Vector3d edge_u = Eigen::Vector3d::UnitX();          ///< world units, at right angles to edge_v
  Eigen::Vector3d edge_v = Eigen::Vector3d::UnitY();
  int texture = 0;                                      ///< index into the world's textures
  Eigen::Vector2d uv_corner = Eigen::Vector2d::Zero();  ///< texture coordinates at the corner ...
  Eigen::Vector2d uv_size = Eigen::Vector2d::Ones();    ///< ... and their change along edge_u and edge_v
  float shade = 1.0f;                                   ///< brightness: factor on the texture's grey values
};

/// A place made of textured quads, lengths in metres, z up. Where a ray meets no quad there is sky. Immutable once
/// built.
struct SyntheticWorld {
  std::vector<Texture> textures;
  std::vector<TexturedQuad> quads;
};

/// Where a ray meets the world first.
struct WorldHit {
  int quad = -1;
  double distance = 0;  ///< in lengths of the direction given
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
};

/// The nearest visible side of a quad along a ray; none in the sky. Exact ground truth, by brute force over the quads.
/// @param direction_in_world any length but 0.
std::optional<WorldHit> CastRay(const SyntheticWorld& world, const Eigen::Vector3d& origin_in_world,
                                const Eigen::Vector3d& direction_in_world);

/// Adds quads and boxes to a world, with shading by the direction a face looks to (one sun, no shadows).
class WorldBuilder {
 public:
  /// What covers a face: a texture, and how many metres of the face its picture spans (0: the whole face, once).
  struct Cover {
    int texture = 0;
    double metres = 0;
    Eigen::Vector2d uv_corner = Eigen::Vector2d::Zero();
  };

  int AddTexture(const cv::Mat& picture);
  void AddQuad(const Eigen::Vector3d& corner, const Eigen::Vector3d& edge_u, const Eigen::Vector3d& edge_v,
               const Cover& cover);
  /// An upright wall whose left foot, as seen by the viewer, is `left` and right foot `right`.
  void AddWall(const Eigen::Vector2d& left, const Eigen::Vector2d& right, double z_low, double z_high,
               const Cover& cover);
  /// A level rectangle seen from above (floor, table top) or, with `from_below`, from below (ceiling).
  void AddLevel(const Eigen::Vector2d& low, const Eigen::Vector2d& high, double z, const Cover& cover,
                bool from_below = false);
  /// A box on a rectangular foot turned by `yaw` about its centre: four walls and a top.
  /// @param size  x, y extents before turning, and height.
  void AddBox(const Eigen::Vector2d& centre, const Eigen::Vector3d& size, double yaw, double z_low, const Cover& sides,
              const Cover& top);

  SyntheticWorld Take() { return std::move(world_); }

 private:
  SyntheticWorld world_;
};

}  // namespace portolan
