#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "dataset/trajectory_io.h"

namespace portolan {

/// Expects every file of a run in a folder, each whole and of its form; and every key of summary.json that scripts rely
/// on (issue 3, Sec. 8).
void ExpectWholeOutput(const std::string& folder);
void ExpectSummaryKeys(const nlohmann::json& summary);

/// Expects a binary PLY with as many vertices as its header says.
/// @return their number.
size_t ExpectWholePly(const std::string& path);

/// Reads a trajectory; a failed expectation and none if it can't be read.
Trajectory ExpectTrajectory(const std::string& path);

/// Expects that the poses agree with the ground truth after alignment: an RMSE of at most `max_share` of the way's
/// length.
void ExpectAccurate(const std::string& truth_file, const std::string& trajectory_file, double max_share);

/// Expects that atlas_server and loop_closer ended with the same maps.
void ExpectSameMaps(const nlohmann::json& atlas_server, const nlohmann::json& loop_closer);

}  // namespace portolan
