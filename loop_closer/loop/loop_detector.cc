#include "loop/loop_detector.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/time.h"
#include "place_recognition/place_agreement.h"

namespace portolan {
namespace {

/// Keyframes in which the place of `current` is known without a loop: those that see its landmarks, and the `most`
/// before it.
std::unordered_set<KeyFrameId> FindOwnSurroundings(const Map& map, KeyFrameId current, int most) {
  std::unordered_set<KeyFrameId> own{current};
  for (const auto& [id, common] : map.CovisibleKeyFrames(current, 1)) own.insert(id);
  auto before = map.keyframes().find(current);
  for (int i = 0; i < most && before != map.keyframes().begin(); ++i) own.insert((--before)->first);
  return own;
}

/// Length of the camera's way from one keyframe to a later one, over those between; none if different trackers made
/// them.
std::optional<double> LengthOfWay(const Map& map, KeyFrameId from, KeyFrameId to) {
  if (from.robot() != to.robot() || from.session() != to.session() || to < from) return std::nullopt;
  double length = 0;
  auto previous = map.keyframes().find(from);
  for (auto next = std::next(previous); next != map.keyframes().end() && !(to < next->first); previous = next++) {
    length +=
        (next->second.camera_from_map.TargetOriginInSource() - previous->second.camera_from_map.TargetOriginInSource())
            .norm();
  }
  return length;
}

LoopRefusal Refuse(const Map& map, KeyFrameId current, KeyFrameId candidate, RefusalKind kind, std::string reason) {
  return {current, candidate,        map.keyframe(current).data->stamp, map.keyframe(candidate).data->stamp,
          kind,    std::move(reason)};
}

}  // namespace

const char* Name(RefusalKind kind) {
  switch (kind) {
    case RefusalKind::kInconsistent:
      return "inconsistent";
    case RefusalKind::kSurplus:
      return "surplus";
    case RefusalKind::kNotVerified:
      return "not_verified";
    case RefusalKind::kDrift:
      return "drift";
    case RefusalKind::kAmbiguous:
      return "ambiguous";
    case RefusalKind::kContradicted:
      return "contradicted";
  }
  return "";
}

Status LoopDetectorOptions::Check() const {
  const auto require = [](bool holds, const char* field, double value, const char* expected) {
    return holds ? Status(Ok{}) : Status(Error{fmt::format("loop.{} is {}, expected {}", field, value, expected)});
  };
  for (const Status& status :
       {require(min_keyframes >= 2, "min_keyframes", min_keyframes, "2 or more"),
        require(min_keyframes_between >= 0, "min_keyframes_between", min_keyframes_between, "0 or more"),
        require(consistent_rounds >= 0, "consistent_rounds", consistent_rounds, "0 or more"),
        require(max_verified >= 1, "max_verified", max_verified, "1 or more"),
        require(max_drift_share > 0, "max_drift_share", max_drift_share, "above 0"),
        require(max_scale_change > 1, "max_scale_change", max_scale_change, "above 1")}) {
    if (!status) return status;
  }
  return Ok{};
}

void LoopDetector::Reset() {
  rounds_.clear();
  confirmations_.clear();
}

LoopDetection LoopDetector::Detect(const Map& map, KeyFrameId current, const KeyFrameIndex& index, StageTimes* times) {
  LoopDetection detection;
  ++round_;
  if (static_cast<int>(map.keyframes().size()) < options_.min_keyframes) return detection;
  const Stopwatch stopwatch;
  const auto own = FindOwnSurroundings(map, current, options_.min_keyframes_between);
  detection.candidates = FindCandidates(map.keyframe(current).data->bow, index, map, options_.candidates,
                                        [&](KeyFrameId id) { return own.count(id) == 1; });
  const std::vector<Candidate> consistent = KeepConsistent(map, current, &detection);
  detection.consistent = static_cast<int>(consistent.size());
  times->Add("words", stopwatch.Milliseconds());

  const std::vector<DetectedLoop> verified = VerifyAll(map, current, consistent, &detection, times);
  if (verified.empty()) return detection;
  const auto best = std::max_element(
      verified.begin(), verified.end(),
      [](const DetectedLoop& a, const DetectedLoop& b) { return a.place.group_inliers < b.place.group_inliers; });
  for (const DetectedLoop& other : verified) {
    if (Agree(map, *best, other)) continue;
    detection.refusals.push_back(
        Refuse(map, current, best->matched, RefusalKind::kAmbiguous,
               fmt::format("ambiguous: {} looks the same and lies elsewhere", ToString(other.matched))));
    return detection;
  }
  Confirm(map, *best, &detection);
  return detection;
}

std::vector<Candidate> LoopDetector::KeepConsistent(const Map& map, KeyFrameId current, LoopDetection* detection) {
  std::vector<Candidate> consistent;
  std::unordered_set<KeyFrameId> round;
  for (const Candidate& candidate : detection->candidates) {
    std::vector<KeyFrameId> group{candidate.keyframe};
    for (const auto& [id, common] : map.CovisibleKeyFrames(candidate.keyframe, 1, options_.candidates.neighbours))
      group.push_back(id);
    const bool was_seen = std::any_of(rounds_.begin(), rounds_.end(), [&](const auto& earlier) {
      return std::any_of(group.begin(), group.end(), [&](KeyFrameId id) { return earlier.count(id) == 1; });
    });
    if (was_seen || options_.consistent_rounds == 0) {
      consistent.push_back(candidate);
    } else {
      detection->refusals.push_back(
          Refuse(map, current, candidate.keyframe, RefusalKind::kInconsistent,
                 fmt::format("not among the candidates of the {} keyframes before", rounds_.size())));
    }
    round.insert(group.begin(), group.end());
  }
  rounds_.push_back(std::move(round));
  while (static_cast<int>(rounds_.size()) > options_.consistent_rounds) rounds_.pop_front();
  return consistent;
}

std::vector<DetectedLoop> LoopDetector::VerifyAll(const Map& map, KeyFrameId current,
                                                  const std::vector<Candidate>& candidates, LoopDetection* detection,
                                                  StageTimes* times) const {
  std::vector<DetectedLoop> verified;
  int tried = 0;
  const auto refuse = [&](const Candidate& candidate, RefusalKind kind, std::string reason) {
    detection->refusals.push_back(Refuse(map, current, candidate.keyframe, kind, std::move(reason)));
  };
  for (const Candidate& candidate : candidates) {
    if (++tried > options_.max_verified) {
      refuse(candidate, RefusalKind::kSurplus, fmt::format("{} better ones were verified", options_.max_verified));
      continue;
    }
    const Stopwatch stopwatch;
    auto place = VerifyPlace(map, current, map, candidate.keyframe, options_.verification, nullptr, times);
    times->Add("verify", stopwatch.Milliseconds());
    if (!place) {
      refuse(candidate, RefusalKind::kNotVerified, place.error().message);
      continue;
    }
    DetectedLoop loop{current, candidate.keyframe, std::move(*place), {}};
    loop.corrected_from_map = Sim3d(map.keyframe(loop.matched).camera_from_map).Inverse() *
                              loop.place.query_from_candidate.Inverse() * Sim3d(map.keyframe(current).camera_from_map);
    if (const auto reason = FindImplausible(map, loop)) {
      refuse(candidate, RefusalKind::kDrift, *reason);
    } else {
      verified.push_back(std::move(loop));
    }
  }
  return verified;
}

std::optional<std::string> LoopDetector::FindImplausible(const Map& map, const DetectedLoop& loop) const {
  const double scale = loop.corrected_from_map.scale;
  if (std::max(scale, 1 / scale) > options_.max_scale_change) {
    return fmt::format("scale would change by {:.2f}, believed is {:.2f} either way", scale, options_.max_scale_change);
  }
  const auto way = LengthOfWay(map, loop.matched, loop.current);
  if (!way) return std::nullopt;
  const Eigen::Vector3d centre = map.keyframe(loop.current).camera_from_map.TargetOriginInSource();
  const double drift = (loop.corrected_from_map * centre - centre).norm();
  // A way much shorter than the depth of the scene tells nothing: the noise of two poses is as long.
  const double noise = options_.max_distance_difference * map.MedianDepth(loop.current);
  if (drift <= options_.max_drift_share * *way + noise) return std::nullopt;
  return fmt::format("the camera would have drifted by {:.2f} on a way of {:.2f}", drift, *way);
}

bool LoopDetector::Agree(const Map& map, const DetectedLoop& a, const DetectedLoop& b) const {
  const PlaceAgreementOptions options{options_.max_scale_difference, options_.max_rotation_difference_deg,
                                      options_.max_distance_difference};
  const Eigen::Vector3d centre = map.keyframe(a.current).camera_from_map.TargetOriginInSource();
  return portolan::Agree(a.corrected_from_map, b.corrected_from_map, centre, map.MedianDepth(a.current), options);
}

void LoopDetector::Confirm(const Map& map, const DetectedLoop& confirmed, LoopDetection* detection) {
  while (!confirmations_.empty() && (round_ - confirmations_.front().round > options_.max_keyframes_apart))
    confirmations_.pop_front();
  bool agrees = false, is_contradicted = false;
  for (const Confirmation& earlier : confirmations_) {
    if (map.FindKeyFrame(earlier.loop.matched) == nullptr) continue;
    if (Agree(map, confirmed, earlier.loop)) {
      agrees = true;
      continue;
    }
    detection->refusals.push_back(Refuse(map, confirmed.current, confirmed.matched, RefusalKind::kContradicted,
                                         fmt::format("contradicts {} seen again from {}",
                                                     ToString(earlier.loop.matched), ToString(earlier.loop.current))));
    is_contradicted = true;
    break;
  }
  confirmations_.push_back({round_, confirmed});  // the next ones must not contradict it either
  if (is_contradicted) return;
  detection->confirmed = confirmed;
  if (agrees) detection->loop = confirmed;
}

}  // namespace portolan
