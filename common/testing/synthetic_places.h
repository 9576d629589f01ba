#pragma once

#include <cstdint>

#include "testing/synthetic_world.h"

namespace portolan {

/// A town of blocks of houses on a regular street grid: kBlocks x kBlocks blocks around a square lap. Streets are
/// centred on the grid lines; the middle block is centred on the origin.
struct TownOptions {
  uint64_t seed = 1;
  int texture_px = 1024;     ///< side of a facade's picture (power of two): about 1 cm a texel on a 10 m front
  double block_x = 38;       ///< m, extent of a block of houses along x ...
  double block_y = 30;       ///< ... and y
  double street_width = 12;  ///< m, from front to front
  /// Look-alike places: every house one of five fronts of one width, no boxes or cars to tell them apart by.
  bool repeat_facades = false;
};
SyntheticWorld MakeTown(const TownOptions& options);

/// A furnished room: walls with pictures, shelves, tables, boxes. Floor at z = 0, centred on the origin.
struct RoomOptions {
  uint64_t seed = 1;
  int texture_px = 1024;
  double size_x = 7, size_y = 5.5, height = 2.8;  ///< m
};
SyntheticWorld MakeRoom(const RoomOptions& options);

/// One wall in the plane x = 0, seen from x < 0, 14 m wide (along y) and 7 m high around z = 1.5. Nothing else.
struct WallOptions {
  uint64_t seed = 1;
  int texture_px = 1024;
};
SyntheticWorld MakeWall(const WallOptions& options);

}  // namespace portolan
