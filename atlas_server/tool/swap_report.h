#pragma once

#include <string>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "map/held_map.h"

namespace portolan {

/// What the atlas_server answers to a swap that was done: who came in whose place, and what each held of the maps.
struct SwapReport {
  struct Entry {
    HeldMap before;  ///< of the old process, at last
    HeldMap after;   ///< of the new one
  };
  std::string role;
  RobotId robot = 0;
  ProcessId from, to;
  double seconds = 0;  ///< from the order to the answer
  std::vector<Entry> maps;

  /// What differs that should not, in words; empty: nothing. Both tell of one state of a map, or the new one of a later
  /// state.
  std::string Problem() const;
};

/// Fails on a text that is none.
Result<SwapReport> ParseSwapReport(const std::string& json);
/// In lines for people.
std::string FormatSwapReport(const SwapReport& report);

}  // namespace portolan
