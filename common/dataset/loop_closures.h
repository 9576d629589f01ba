#pragma once

#include <string>
#include <vector>

#include "base/result.h"
#include "base/time.h"

namespace portolan {

/// A place seen twice: the time of the frame that closed the loop, and of the earlier one it was found to match.
struct LoopClosure {
  Timestamp stamp;
  Timestamp matched_stamp;
};

/// Reads the array "closures" of a JSON file (loop_closer.json, summary.json): objects with integers "stamp_ns" and
/// "matched_stamp_ns"; those with "applied": false are left out, other keys are passed over. Fails naming the file, and
/// the key or the place in it.
Result<std::vector<LoopClosure>> ReadLoopClosures(const std::string& path);

}  // namespace portolan
