#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "base/random.h"
#include "testing/synthetic_places.h"
#include "testing/texture_painter.h"

namespace portolan {
namespace {

using Cover = WorldBuilder::Cover;

void AddShell(const RoomOptions& options, Random* random, WorldBuilder* builder) {
  const double x = options.size_x / 2, y = options.size_y / 2, top = options.height;
  const int side = options.texture_px;
  const auto wall = [&] { return Cover{builder->AddTexture(PaintRoomWall({2 * side, side}, random))}; };
  builder->AddWall({-x, y}, {x, y}, 0, top, wall());
  builder->AddWall({x, y}, {x, -y}, 0, top, wall());
  builder->AddWall({x, -y}, {-x, -y}, 0, top, wall());
  builder->AddWall({-x, -y}, {-x, y}, 0, top, wall());
  builder->AddLevel({-x, -y}, {x, y}, 0, {builder->AddTexture(PaintPlanks(side, 24, random)), 4.0});
  builder->AddLevel({-x, -y}, {x, y}, top, {builder->AddTexture(PaintPavement(side, 10, random)), 6.0}, true);
}

/// A table: a plate on four legs, with things on it.
void AddTable(const Eigen::Vector2d& centre, double yaw, const std::vector<int>& things, Random* random,
              WorldBuilder* builder) {
  constexpr double kLength = 1.6, kWidth = 0.8, kHeight = 0.74;
  const Eigen::Rotation2Dd turn(yaw);
  const Cover wood{builder->AddTexture(PaintPlanks(256, 6, random)), 1.6};
  builder->AddBox(centre, {kLength, kWidth, 0.04}, yaw, kHeight - 0.04, wood, wood);
  for (const double x : {-0.45, 0.45}) {
    for (const double y : {-0.42, 0.42}) {
      builder->AddBox(centre + turn * Eigen::Vector2d(x * kLength, y * kWidth), {0.06, 0.06, kHeight - 0.04}, yaw, 0,
                      wood, wood);
    }
  }
  for (int k = 0; k < 6; ++k) {
    const Eigen::Vector2d at((k - 2.5) * kLength / 6.5, random->Uniform(-0.3, 0.3) * kWidth);
    const Eigen::Vector3d size(random->Uniform(0.08, 0.22), random->Uniform(0.08, 0.25), random->Uniform(0.05, 0.4));
    const Cover cover{things[random->Below(things.size())], 0.5, {random->Uniform(), random->Uniform()}};
    builder->AddBox(centre + turn * at, size, random->Uniform(-0.8, 0.8), kHeight, cover, cover);
  }
}

void AddFurniture(const RoomOptions& options, Random* random, WorldBuilder* builder) {
  const double x = options.size_x / 2, y = options.size_y / 2;
  std::vector<int> things;
  for (int i = 0; i < 10; ++i) things.push_back(builder->AddTexture(PaintPoster({256, 256}, random)));
  const auto shelf = [&](const Eigen::Vector2d& at, double yaw, double width) {
    const Cover books{builder->AddTexture(PaintBookshelf(512, 5, random)), 1.9};
    builder->AddBox(at, {width, 0.35, 1.9}, yaw, 0, books, {things[0], 1.0});
  };
  shelf({-0.45 * x, y - 0.2}, 0, 1.8);
  shelf({0.5 * x, -y + 0.2}, M_PI, 1.4);
  shelf({x - 0.2, 0.45 * y}, -M_PI / 2, 1.2);
  AddTable({0.55 * x, 0.62 * y}, 0.1, things, random, builder);
  AddTable({-0.55 * x, -0.6 * y}, -0.2, things, random, builder);
  AddTable({-x + 0.6, 0.3 * y}, M_PI / 2, things, random, builder);
  for (int k = 0; k < 14; ++k) {  // crates along the walls
    const double angle = 2 * M_PI * k / 14 + random->Uniform(-0.1, 0.1);
    const Eigen::Vector2d at(0.82 * x * std::cos(angle), 0.8 * y * std::sin(angle));
    const Eigen::Vector3d size(random->Uniform(0.25, 0.5), random->Uniform(0.25, 0.5), random->Uniform(0.2, 0.6));
    const Cover cover{things[random->Below(things.size())], 0.6, {random->Uniform(), random->Uniform()}};
    builder->AddBox(at, size, random->Uniform(-0.8, 0.8), 0, cover, cover);
  }
}

}  // namespace

SyntheticWorld MakeRoom(const RoomOptions& options) {
  Random random(options.seed);
  WorldBuilder builder;
  AddShell(options, &random, &builder);
  AddFurniture(options, &random, &builder);
  return builder.Take();
}

SyntheticWorld MakeWall(const WallOptions& options) {
  Random random(options.seed);
  WorldBuilder builder;
  const int side = options.texture_px;
  const int picture = builder.AddTexture(PaintRoomWall({2 * side, side}, &random));
  builder.AddWall({0, 7}, {0, -7}, -2, 5, {picture});
  return builder.Take();
}

}  // namespace portolan
