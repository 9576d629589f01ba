#include <algorithm>
#include <vector>

#include "base/random.h"
#include "testing/synthetic_places.h"
#include "testing/texture_painter.h"

namespace portolan {
namespace {

constexpr int kBlocks = 3;              // in each direction: a lap goes around the middle one
constexpr double kPavementWidth = 2.2;  // m
constexpr double kKerb = 0.12;          // m
constexpr double kHouseDepth = 8.0;     // m
constexpr int kRepeatedFacades = 5;
constexpr double kRepeatedWidth = 9.5;  // m
constexpr double kGroundTile = 12;      // m

/// Builds the town, house by house.
class TownMaker {
 public:
  explicit TownMaker(const TownOptions& options) : options_(options), random_(options.seed) {}

  SyntheticWorld Make() {
    PaintPools();
    AddGround();
    for (int i = 0; i < kBlocks; ++i) {
      for (int j = 0; j < kBlocks; ++j) AddBlock(i, j);
    }
    CloseStreets();
    return builder_.Take();
  }

 private:
  using Cover = WorldBuilder::Cover;

  double pitch_x() const { return options_.block_x + options_.street_width; }
  double pitch_y() const { return options_.block_y + options_.street_width; }
  double Uniform(double low, double high) { return random_.Uniform(low, high); }

  void PaintPools() {
    const int half = std::max(64, options_.texture_px / 2);
    for (int i = 0; i < 4; ++i)
      cobbles_.push_back(builder_.AddTexture(PaintCobbles(options_.texture_px, 44 + 8 * i, &random_)));
    for (int i = 0; i < 3; ++i) pavements_.push_back(builder_.AddTexture(PaintPavement(half, 8, &random_)));
    for (int i = 0; i < 6; ++i)
      sides_.push_back(builder_.AddTexture(PaintBricks(half, 40, Uniform(90, 180), &random_)));
    for (int i = 0; i < 12; ++i) things_.push_back(builder_.AddTexture(PaintPoster({half, half}, &random_)));
    if (!options_.repeat_facades) return;
    for (int i = 0; i < kRepeatedFacades; ++i) {
      facades_.push_back(builder_.AddTexture(PaintFacade(options_.texture_px, 4, &random_)));
    }
  }

  int Pick(const std::vector<int>& pool) { return pool[random_.Below(pool.size())]; }

  int NextFacade() {
    if (options_.repeat_facades) return facades_[next_facade_++ % facades_.size()];
    return builder_.AddTexture(PaintFacade(options_.texture_px, 3 + static_cast<int>(random_.Below(3)), &random_));
  }

  void AddGround() {
    const double x = kBlocks * pitch_x() / 2 + 2 * kGroundTile, y = kBlocks * pitch_y() / 2 + 2 * kGroundTile;
    for (double at_x = -x; at_x < x; at_x += kGroundTile) {
      for (double at_y = -y; at_y < y; at_y += kGroundTile) {
        const Cover cover{Pick(cobbles_), kGroundTile, {Uniform(0, 1), Uniform(0, 1)}};
        builder_.AddLevel({at_x, at_y}, {at_x + kGroundTile, at_y + kGroundTile}, 0, cover);
      }
    }
  }

  /// Houses across the ends of the streets, on the far side of the road around the town.
  void CloseStreets() {
    const double wide = options_.street_width, x = kBlocks * pitch_x() / 2, y = kBlocks * pitch_y() / 2;
    for (int k = 1; k < kBlocks; ++k) {
      const double street_x = k * pitch_x() - x, street_y = k * pitch_y() - y;
      AddFront({street_x - wide, y}, {street_x + wide, y}, false, false);
      AddFront({street_x + wide, -y}, {street_x - wide, -y}, false, false);
      AddFront({-x, street_y - wide}, {-x, street_y + wide}, false, false);
      AddFront({x, street_y + wide}, {x, street_y - wide}, false, false);
    }
  }

  void AddBlock(int i, int j) {
    const int middle = kBlocks / 2;
    const Eigen::Vector2d centre((i - middle) * pitch_x(), (j - middle) * pitch_y());
    const Eigen::Vector2d half(options_.block_x / 2, options_.block_y / 2);
    const Cover paving{Pick(pavements_), 6.0};
    builder_.AddBox(centre, {2 * (half.x() + kPavementWidth), 2 * (half.y() + kPavementWidth), kKerb}, 0, 0, paving,
                    paving);
    // The four fronts, each from its left end as seen from its street. The town's outer fronts are never seen and left
    // out. Houses of the fronts along x turn the corners: their outer side walls are fronts on the streets along y.
    const Eigen::Vector2d a = centre - half, c = centre + half, b(c.x(), a.y()), d(a.x(), c.y());
    const Eigen::Vector2d deep(0, kHouseDepth);
    const bool west = i > 0, east = i + 1 < kBlocks;
    if (j > 0) AddFront(a, b, west, east);
    if (east) AddFront(b + deep, c - deep, false, false);
    if (j + 1 < kBlocks) AddFront(c, d, east, west);
    if (west) AddFront(d - deep, a + deep, false, false);
  }

  /// Houses side by side from `left` to `right`, fronts to the street. @param left_front whether the left side of the
  /// first one is a front too.
  void AddFront(const Eigen::Vector2d& left, const Eigen::Vector2d& right, bool left_front, bool right_front) {
    const Eigen::Vector2d unit = (right - left).normalized();
    const double length = (right - left).norm();
    const double mean_width = options_.repeat_facades ? kRepeatedWidth : Uniform(8.5, 11.5);
    const int houses = std::max(1, static_cast<int>(length / mean_width + 0.5));
    double at = 0;
    for (int k = 0; k < houses; ++k) {
      const double even = (length - at) / (houses - k);
      const double width = k + 1 == houses || options_.repeat_facades ? even : even * Uniform(0.82, 1.18);
      AddHouse(left + at * unit, unit, width, k == 0 && left_front, k + 1 == houses && right_front);
      at += width;
    }
  }

  void AddHouse(const Eigen::Vector2d& left, const Eigen::Vector2d& unit, double width, bool left_front,
                bool right_front) {
    const Eigen::Vector2d inwards(-unit.y(), unit.x());
    const double height = options_.repeat_facades ? 11.0 : Uniform(7.5, 14.0);
    const double setback = options_.repeat_facades || left_front || right_front ? 0.0 : Uniform(0.0, 0.7);
    const Eigen::Vector2d front = left + setback * inwards, back = left + kHouseDepth * inwards, along = width * unit;
    const Cover side{Pick(sides_), 5.0, {Uniform(0, 1), Uniform(0, 1)}};
    builder_.AddWall(front, front + along, 0, height, {NextFacade()});
    builder_.AddWall(back, front, 0, height, left_front ? Cover{NextFacade()} : side);
    builder_.AddWall(front + along, back + along, 0, height, right_front ? Cover{NextFacade()} : side);
    if (!options_.repeat_facades) Furnish(front, unit, width, height);
  }

  /// What stands and hangs before a front: balconies, awnings, crates, parked cars, lamps. Gives depth besides the
  /// planes of the walls.
  void Furnish(const Eigen::Vector2d& front, const Eigen::Vector2d& unit, double width, double height) {
    const Eigen::Vector2d outwards(unit.y(), -unit.x());
    const double yaw = std::atan2(unit.y(), unit.x());
    const auto box = [&](double along, double out, const Eigen::Vector3d& size, double z_low, double turn,
                         double metres) {
      const Cover cover{Pick(things_), metres, {Uniform(0, 1), Uniform(0, 1)}};
      builder_.AddBox(front + along * unit + out * outwards, size, yaw + turn, z_low, cover, cover);
    };
    for (int k = static_cast<int>(random_.Below(3)); k > 0; --k) {
      box(Uniform(1.5, width - 1.5), 0.35, {Uniform(1.2, 2.4), 0.7, Uniform(0.5, 1.0)}, Uniform(2.8, height - 1.5), 0,
          1.5);
    }
    for (int k = static_cast<int>(random_.Below(3)); k > 0; --k) {
      box(Uniform(1.0, width - 1.0), Uniform(0.8, 1.4), {Uniform(0.4, 1.0), Uniform(0.4, 0.9), Uniform(0.5, 1.5)},
          kKerb, Uniform(-0.6, 0.6), 1.2);
    }
    if (random_.Below(3) == 0) box(Uniform(2.5, width - 2.5), 3.2, {4.0, 1.6, 0.9}, 0.25, Uniform(-0.05, 0.05), 4.0);
    if (random_.Below(2) == 0) box(Uniform(0.5, width - 0.5), 1.9, {0.16, 0.16, 4.5}, kKerb, 0, 2.0);
  }

  const TownOptions options_;
  Random random_;
  WorldBuilder builder_;
  std::vector<int> cobbles_, pavements_, sides_, things_, facades_;
  size_t next_facade_ = 0;
};

}  // namespace

SyntheticWorld MakeTown(const TownOptions& options) {
  return TownMaker(options).Make();
}

}  // namespace portolan
