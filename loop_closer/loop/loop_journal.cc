#include "loop/loop_journal.h"

#include <fmt/format.h>

#include <numeric>

namespace portolan {
namespace {

constexpr size_t kMaxRefusals = 500;  // kept for the report
constexpr double kDegPerRad = 180.0 / M_PI;

double Sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

std::string InWords(const Sim3d& similarity) {
  const double turn_deg = kDegPerRad * similarity.rotation.angularDistance(Eigen::Quaterniond::Identity());
  const Eigen::Vector3d& moved = similarity.translation;
  return fmt::format("scale {:.3f}, turned by {:.2f} deg, moved by ({:.3f}, {:.3f}, {:.3f})", similarity.scale,
                     turn_deg, moved.x(), moved.y(), moved.z());
}

std::string InWords(const StageTimes& times) {
  std::string text;
  for (const auto& [step, samples] : times.samples())
    text += fmt::format("{}{} {:.1f} ms", text.empty() ? "" : ", ", step, samples.back());
  return text;
}

/// "0.3fa21c.17 (frame 412)".
std::string InWords(const Map& map, KeyFrameId id) {
  return fmt::format("{} (frame {})", ToString(id), map.keyframe(id).data->frame);
}

void TellCandidates(const Map& map, KeyFrameId keyframe, const std::vector<Candidate>& candidates) {
  if (candidates.empty() || !spdlog::should_log(spdlog::level::debug)) return;
  std::string text;
  for (const Candidate& candidate : candidates) {
    text += fmt::format("{}{} {:.4f} (accumulated {:.4f})", text.empty() ? "" : ", ", ToString(candidate.keyframe),
                        candidate.score, candidate.accumulated_score);
  }
  spdlog::debug("loop: {} has the candidates {}", InWords(map, keyframe), text);
}

}  // namespace

const char* Name(LoopJobKind kind) {
  switch (kind) {
    case LoopJobKind::kLoop:
      return "loop correction";
    case LoopJobKind::kGlobalBundleAdjustment:
      return "global BA";
    case LoopJobKind::kForwardBundleAdjustment:
      return "FBA";
  }
  return "";
}

uint64_t LoopCounters::cancelled() const {
  uint64_t sum = 0;
  for (const LoopJobCounters& counters : jobs) sum += counters.cancelled;
  return sum;
}

void LoopJournal::NoteDetection(const Map& map, KeyFrameId keyframe, const LoopDetection& detection) {
  ++counters_.looked_at;
  counters_.candidates += detection.candidates.size();
  counters_.consistent += static_cast<uint64_t>(detection.consistent);
  TellCandidates(map, keyframe, detection.candidates);
  for (const LoopRefusal& refusal : detection.refusals) NoteRefusal(map, refusal);
  if (!detection.confirmed) return;
  ++counters_.confirmed;
  spdlog::info("loop: {} sees the place of {} ({} landmarks){}", ToString(keyframe),
               ToString(detection.confirmed->matched), detection.confirmed->place.group_inliers,
               detection.loop ? "" : "; waits for another keyframe to say the same");
}

void LoopJournal::NoteRefusal(const Map& map, const LoopRefusal& refusal) {
  ++counters_.refusals[static_cast<size_t>(refusal.kind)];
  const bool is_told = WasVerified(refusal.kind) && refusal_log_.Allow();
  const std::string others = is_told && refusal_log_.suppressed() > 0
                                 ? fmt::format("; {} others were refused before it", refusal_log_.suppressed())
                                 : std::string();
  spdlog::log(is_told ? spdlog::level::info : spdlog::level::debug, "loop: {} is not {}: {}{}",
              InWords(map, refusal.current), InWords(map, refusal.candidate), refusal.reason, others);
  if (!WasVerified(refusal.kind)) return;  // too many to be kept: they would take the place of the others
  ++counters_.refused;
  refusals_.push_back(refusal);
  if (refusals_.size() > kMaxRefusals) refusals_.pop_front();
}

size_t LoopJournal::OpenClosure(const Map& map, const DetectedLoop& loop, const StageTimes& times) {
  ClosureRecord record;
  record.current = loop.current;
  record.matched = loop.matched;
  record.stamp = map.keyframe(loop.current).data->stamp;
  record.matched_stamp = map.keyframe(loop.matched).data->stamp;
  record.corrected_from_map = loop.corrected_from_map;
  record.inliers = loop.place.inliers;
  record.group_inliers = loop.place.group_inliers;
  for (const auto& [step, samples] : times.samples()) record.times.Add(step, Sum(samples));  // over the candidates
  spdlog::info("loop: {} closes with {}: scale {:.3f}, {} inliers, {} landmarks seen again", InWords(map, loop.current),
               InWords(map, loop.matched), loop.corrected_from_map.scale, loop.place.inliers, loop.place.group_inliers);
  closures_.push_back(std::move(record));
  return closures_.size() - 1;
}

void LoopJournal::AddTimes(size_t closure, const StageTimes& times) {
  for (const auto& [step, samples] : times.samples()) closures_[closure].times.Add(step, samples.back());
}

void LoopJournal::NoteApplied(size_t closure, double since_detection_ms) {
  ClosureRecord& record = closures_[closure];
  if (!record.problem.empty()) --counters_.failed;
  ++counters_.closed;
  record.is_applied = true;
  record.problem.clear();
  record.times.Add("applied", since_detection_ms);
  spdlog::info("loop: {} is closed with {}: {}; {} inliers, {} landmarks; {}", ToString(record.current),
               ToString(record.matched), InWords(record.corrected_from_map), record.inliers, record.group_inliers,
               InWords(record.times));
}

void LoopJournal::NoteFailed(size_t closure, const std::string& problem) {
  ClosureRecord& record = closures_[closure];
  if (record.problem.empty()) ++counters_.failed;
  record.problem = problem;
  spdlog::info("loop: {} is not closed with {}: {}", ToString(record.current), ToString(record.matched), problem);
}

void LoopJournal::NoteCancelled(LoopJobKind kind, MapId map) {
  ++Of(kind).cancelled;
  spdlog::info("{} of map {} cancelled", Name(kind), ToString(map));
}

void LoopJournal::NoteFruitless(LoopJobKind kind, MapId map, const std::string& reason) {
  ++Of(kind).fruitless;
  spdlog::info("{} of map {} came to nothing: {}", Name(kind), ToString(map), reason);
}

void LoopJournal::NoteProposed(LoopJobKind kind, MapId map) {
  if (const auto& losses = Of(kind).losses) {
    spdlog::info("{} of map {} is proposed: mean reprojection loss {:.5f}, without it {:.5f}", Name(kind),
                 ToString(map), losses->with, losses->without);
  }
}

void LoopJournal::NoteUnanswered(LoopJobKind kind, const std::string& reason) {
  ++Of(kind).unanswered;
  spdlog::warn("{}: {}", Name(kind), reason);
}

void LoopJournal::NoteAnswered(LoopJobKind kind, MapId map, const std::string& refusal, bool is_late) {
  LoopJobCounters& counters = Of(kind);
  if (is_late) --counters.unanswered;
  if (refusal.empty()) {
    ++counters.applied;
    spdlog::info("{} of map {} is applied", Name(kind), ToString(map));
  } else {
    ++counters.refused;
    spdlog::warn("the owner of map {} refused the {}: {}", ToString(map), Name(kind), refusal);
  }
}

}  // namespace portolan
