#pragma once

#include <string>

#include "atlas/map_joiner.h"
#include "atlas/map_shelf.h"
#include "atlas/overlap_detector.h"
#include "atlas/place_locator.h"
#include "base/config_reader.h"
#include "map_optimization/loop_correction.h"

namespace portolan {

struct AtlasOptions {
  std::string
      store;  ///< file of the atlas; empty: atlas.db in the output folder, if there is one; "none": nothing is stored
  /// Between two pieces of a growing map that are stored: what a crash of all processes costs at most.
  double store_interval_s = 0.2;
  bool join_maps = true;  ///< off: maps are followed, granted and stored, and overlaps are not looked for
  int max_waiting = 5;    ///< keyframes of a robot that wait to be looked up; of more the newest
  ShelfOptions shelf;
  OverlapOptions overlap;
  JoinOptions join;
  LocatorOptions locator;
  LoopCorrectionOptions fusion;
};

/// Reads the section atlas.
Status ReadAtlasOptions(ConfigReader* config, AtlasOptions* options);

/// Where the store is, given the output folder (may be empty). Empty: nowhere.
std::string StorePath(const AtlasOptions& options, const std::string& out);

}  // namespace portolan
