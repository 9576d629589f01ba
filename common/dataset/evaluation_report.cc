#include "dataset/evaluation_report.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace portolan {
namespace {

std::string FormatRow(const std::string& name, const ErrorStatistics& errors, const std::string& rest = "") {
  return fmt::format("{:<18}{:>6}{:>11.5f}{:>11.5f}{:>11.5f}{:>11.5f}{:>11.5f}  {}\n", name, errors.count, errors.rmse,
                     errors.mean, errors.median, errors.std, errors.max, rest);
}

std::string FormatMap(const std::string& name, const AlignedMap& map) {
  if (!map.truth_from_map) return fmt::format("{:<18}{:>6}  not aligned: {}\n", name, map.pairs.size(), map.failure);
  return FormatRow(name, map.ate, fmt::format("scale {:.6g}", map.truth_from_map->scale));
}

nlohmann::ordered_json ToJson(const ErrorStatistics& errors) {
  return {{"count", errors.count},   {"rmse", errors.rmse}, {"mean", errors.mean},
          {"median", errors.median}, {"std", errors.std},   {"max", errors.max}};
}

nlohmann::ordered_json ToJson(const AlignedMap& map) {
  nlohmann::ordered_json json{{"poses", map.estimate.size()}, {"matched", map.pairs.size()}};
  if (map.truth_from_map) {
    json["scale"] = map.truth_from_map->scale;
    json["ate"] = ToJson(map.ate);
  } else {
    json["failure"] = map.failure;
  }
  return json;
}

}  // namespace

std::string FormatEvaluation(const Evaluation& evaluation, const std::string& rpe_name) {
  std::string text = fmt::format("frames {}, tracked {}, coverage {:.1f} %, matched {} within {:.4f} s\n",
                                 evaluation.num_frames, evaluation.num_tracked, 100 * evaluation.Coverage(),
                                 evaluation.joined.pairs.size(), evaluation.max_dt);
  text +=
      fmt::format("{:<18}{:>6}{:>11}{:>11}{:>11}{:>11}{:>11}\n", "", "count", "rmse", "mean", "median", "std", "max");
  text += FormatMap("ATE", evaluation.joined);
  if (evaluation.maps.size() > 1) {
    for (const AlignedMap& map : evaluation.maps) text += FormatMap(fmt::format("ATE of map {}", map.map), map);
    text += FormatRow("ATE maps combined", evaluation.maps_combined);
  }
  text += FormatRow("RPE " + rpe_name, evaluation.rpe_translation);
  text += FormatRow("RPE " + rpe_name + ", deg", evaluation.rpe_rotation_deg);
  return text;
}

std::string EvaluationToJson(const Evaluation& evaluation) {
  nlohmann::ordered_json maps = nlohmann::ordered_json::array();
  for (const AlignedMap& map : evaluation.maps) {
    nlohmann::ordered_json one = ToJson(map);
    one["map"] = map.map;
    maps.push_back(one);
  }
  const nlohmann::ordered_json json{{"frames", evaluation.num_frames},
                                    {"tracked", evaluation.num_tracked},
                                    {"coverage", evaluation.Coverage()},
                                    {"max_dt", evaluation.max_dt},
                                    {"joined", ToJson(evaluation.joined)},
                                    {"maps", maps},
                                    {"maps_combined", ToJson(evaluation.maps_combined)},
                                    {"rpe_translation", ToJson(evaluation.rpe_translation)},
                                    {"rpe_rotation_deg", ToJson(evaluation.rpe_rotation_deg)}};
  return json.dump(2) + "\n";
}

}  // namespace portolan
