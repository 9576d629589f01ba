#pragma once

#include <string>

#include "dataset/trajectory_evaluation.h"

namespace portolan {

/// A text table: coverage, ATE joined, per map and combined, RPE.
/// @param rpe_name of the interval, as in "1 s" or "10 frames".
std::string FormatEvaluation(const Evaluation& evaluation, const std::string& rpe_name);

/// The same as one JSON object with the keys frames, tracked, coverage, max_dt, joined, maps, maps_combined,
/// rpe_translation, rpe_rotation_deg.
std::string EvaluationToJson(const Evaluation& evaluation);

}  // namespace portolan
