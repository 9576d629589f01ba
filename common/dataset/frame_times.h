#pragma once

#include <string>
#include <vector>

#include "base/result.h"
#include "base/time.h"

namespace portolan {

/// The times of a camera's frames: the first column of rgb.txt (TUM) or times.txt (KITTI) in seconds, of a data.csv
/// (EuRoC) in nanoseconds. Fails naming file and line.
Result<std::vector<Timestamp>> ReadFrameTimes(const std::string& path);

/// The list of frames that lies beside a data set's ground truth: rgb.txt or times.txt in its folder, ../cam0/data.csv
/// for EuRoC; else empty.
std::string FindFrameTimes(const std::string& groundtruth);

}  // namespace portolan
