#include "process/loop_report.h"

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

}  // namespace

void AddLoops(const LoopCloser& closer, nlohmann::json* report) {
  const LoopCloser::Counters& counters = closer.counters();
  (*report)["loops"] = counters.closed;
  (*report)["closures"] = nlohmann::json::array();
  for (const ClosureRecord& record : closer.closures()) (*report)["closures"].push_back(ToJson(record));
  (*report)["refusals"] = nlohmann::json::array();
  for (const LoopRefusal& refusal : closer.refusals()) {
    (*report)["refusals"].push_back({{"keyframe", ToString(refusal.current)},
                                     {"candidate", ToString(refusal.candidate)},
                                     {"reason", refusal.reason}});
  }
  (*report)["loop_counters"] = {
      {"looked_at", counters.looked_at},   {"passed_over", counters.passed_over}, {"candidates", counters.candidates},
      {"consistent", counters.consistent}, {"refused", counters.refused},         {"confirmed", counters.confirmed},
      {"closed", counters.closed},         {"failed", counters.failed},           {"global_ba", counters.global_ba},
      {"forward_ba", counters.forward_ba}, {"cancelled", counters.cancelled}};
}

}  // namespace portolan
