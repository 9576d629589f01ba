#include "process/loop_report.h"

#include <algorithm>
#include <array>

namespace portolan {
namespace {

nlohmann::json ToJson(const ClosureRecord& record) {
  nlohmann::json times = nlohmann::json::object();
  for (const auto& [step, samples] : record.times.samples()) times[step] = samples.back();
  const Sim3d& similarity = record.corrected_from_map;
  return {{"keyframe", ToString(record.current)},
          {"matched", ToString(record.matched)},
          {"stamp_ns", record.stamp.ns},
          {"matched_stamp_ns", record.matched_stamp.ns},
          {"inliers", record.inliers},
          {"landmarks", record.group_inliers},
          {"scale", similarity.scale},
          {"rotation",
           {similarity.rotation.x(), similarity.rotation.y(), similarity.rotation.z(), similarity.rotation.w()}},
          {"translation", {similarity.translation.x(), similarity.translation.y(), similarity.translation.z()}},
          {"milliseconds", times},
          {"applied", record.is_applied},
          {"problem", record.problem}};
}

nlohmann::json ToJson(const LoopRefusal& refusal) {
  return {{"keyframe", ToString(refusal.current)},
          {"candidate", ToString(refusal.candidate)},
          {"stamp_ns", refusal.stamp.ns},
          {"candidate_stamp_ns", refusal.candidate_stamp.ns},
          {"kind", Name(refusal.kind)},
          {"reason", refusal.reason}};
}

nlohmann::json ToJson(const LoopJobCounters& counters) {
  nlohmann::json json = {{"tried", counters.tried},         {"fruitless", counters.fruitless},
                         {"cancelled", counters.cancelled}, {"applied", counters.applied},
                         {"refused", counters.refused},     {"unanswered", counters.unanswered}};
  if (!counters.losses) return json;
  json["loss"] = counters.losses->with;
  json["loss_without"] = counters.losses->without;
  return json;
}

std::string KeyOf(LoopJobKind kind) {
  switch (kind) {
    case LoopJobKind::kLoop:
      return "loop";
    case LoopJobKind::kGlobalBundleAdjustment:
      return "global_ba";
    case LoopJobKind::kForwardBundleAdjustment:
      return "forward_ba";
  }
  return "";
}

constexpr std::array kJobKinds = {LoopJobKind::kLoop, LoopJobKind::kGlobalBundleAdjustment,
                                  LoopJobKind::kForwardBundleAdjustment};

}  // namespace

void AddLoops(const LoopJournal& journal, nlohmann::json* report) {
  const LoopCounters& counters = journal.counters();
  (*report)["loops"] = counters.closed;
  (*report)["closures"] = nlohmann::json::array();
  for (const ClosureRecord& record : journal.closures()) (*report)["closures"].push_back(ToJson(record));
  (*report)["refusals"] = nlohmann::json::array();
  for (const LoopRefusal& refusal : journal.refusals()) (*report)["refusals"].push_back(ToJson(refusal));
  nlohmann::json& numbers = (*report)["loop_counters"];
  numbers = {
      {"looked_at", counters.looked_at},   {"passed_over", counters.passed_over}, {"candidates", counters.candidates},
      {"consistent", counters.consistent}, {"refused", counters.refused},         {"confirmed", counters.confirmed},
      {"closed", counters.closed},         {"failed", counters.failed},           {"cancelled", counters.cancelled()}};
  for (size_t kind = 0; kind < kNumRefusalKinds; ++kind)
    numbers["refused_" + std::string(Name(static_cast<RefusalKind>(kind)))] = counters.refusals[kind];
  numbers["global_ba"] = counters.of(LoopJobKind::kGlobalBundleAdjustment).applied;
  numbers["forward_ba"] = counters.of(LoopJobKind::kForwardBundleAdjustment).applied;
  for (const LoopJobKind kind : kJobKinds) numbers["jobs"][KeyOf(kind)] = ToJson(counters.of(kind));
}

std::vector<std::pair<std::string, double>> LoopFigures(const LoopJournal& journal) {
  const LoopCounters& counters = journal.counters();
  std::vector<std::pair<std::string, double>> figures = {
      {"loops", static_cast<double>(counters.closed)},
      {"loop_candidates", static_cast<double>(counters.candidates)},
      {"loop_consistent", static_cast<double>(counters.consistent)},
      {"loop_refusals", static_cast<double>(counters.refused)},
      {"loop_confirmed", static_cast<double>(counters.confirmed)},
      {"loop_failed", static_cast<double>(counters.failed)},
      {"loop_cancelled", static_cast<double>(counters.cancelled())},
      {"global_ba", static_cast<double>(counters.of(LoopJobKind::kGlobalBundleAdjustment).applied)},
      {"global_ba_fruitless", static_cast<double>(counters.of(LoopJobKind::kGlobalBundleAdjustment).fruitless)},
      {"forward_ba", static_cast<double>(counters.of(LoopJobKind::kForwardBundleAdjustment).applied)},
      {"forward_ba_fruitless", static_cast<double>(counters.of(LoopJobKind::kForwardBundleAdjustment).fruitless)}};
  for (size_t kind = 0; kind < kNumRefusalKinds; ++kind) {
    figures.emplace_back("loop_refused_" + std::string(Name(static_cast<RefusalKind>(kind))),
                         static_cast<double>(counters.refusals[kind]));
  }
  const auto& closures = journal.closures();
  const auto last =
      std::find_if(closures.rbegin(), closures.rend(), [](const auto& record) { return record.is_applied; });
  if (last == closures.rend()) return figures;
  figures.emplace_back("last_loop_scale", last->corrected_from_map.scale);
  figures.emplace_back("last_loop_inliers", last->inliers);
  figures.emplace_back("last_loop_s", 1e-3 * last->times.samples().at("applied").back());
  return figures;
}

}  // namespace portolan
