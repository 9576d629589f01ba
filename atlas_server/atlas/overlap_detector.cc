#include "atlas/overlap_detector.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

#include "base/check.h"
#include "base/time.h"

namespace portolan {
namespace {

// Keyframes whose scores are accumulated over their neighbours, over all maps: with many maps fewer of each, three at
// least.
constexpr size_t kMaxScored = 60, kMinScoredOfMap = 3;
// Keyframes for which a map keeps its turn: for as many candidates must be consistent, and two keyframes agree.
constexpr int kTurn = 8;
// Words looked up, times maps: each takes a walk over the keyframes that have it, of all maps. With many maps the most
// telling ones.
constexpr size_t kMaxWords = 4000;

/// Those with the largest weights, of equal ones the first; sorted by word.
BowVector MostTelling(const BowVector& bow, size_t most) {
  if (bow.size() <= most) return bow;
  BowVector telling = bow;
  std::stable_sort(telling.begin(), telling.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  telling.resize(most);
  std::sort(telling.begin(), telling.end());
  return telling;
}

}  // namespace

Status OverlapOptions::Check() const {
  const auto require = [](bool holds, const char* field, auto value, const char* expected) {
    return holds ? Status(Ok{}) : Status(Error{fmt::format("atlas.{} is {}, expected {}", field, value, expected)});
  };
  for (const Status& status :
       {require(max_verified >= 1, "max_verified", max_verified, "1 or more"),
        require(consistent_rounds >= 0, "consistent_rounds", consistent_rounds, "0 or more"),
        require(max_keyframes_apart >= 1, "max_keyframes_apart", max_keyframes_apart, "1 or more"),
        require(max_looked_up >= 1, "max_looked_up", max_looked_up, "1 or more")}) {
    if (!status) return status;
  }
  return Ok{};
}

std::vector<std::vector<SharedWords>> QueryMaps(const BowVector& bow, const std::vector<const OtherMap*>& maps) {
  if (maps.empty()) return {};
  std::vector<MapId> parts;
  for (const OtherMap* other : maps) {
    PORTOLAN_CHECK(other->words == maps.front()->words) << "map " << other->id << " has an index of its own";
    parts.push_back(other->id);
  }
  return maps.front()->words->Query(bow, parts);
}

std::vector<KeyFrameId> KeyFramesRead(const Map& map, KeyFrameId keyframe, const NeighbourhoodOptions& options,
                                      size_t most) {
  const Neighbourhood side(map, keyframe, options);
  std::vector<KeyFrameId> read;
  for (size_t i = 0; i < side.keyframes().size() && i < most; ++i) read.push_back(side.keyframes()[i]->data->id);
  return read;
}

void OverlapDetector::Forget(MapId map) {
  memories_.erase(map);
  for (auto& [id, memory] : memories_) {
    memory.verified.erase(map);
    auto& confirmations = memory.confirmations;
    confirmations.erase(std::remove_if(confirmations.begin(), confirmations.end(),
                                       [map](const Confirmation& c) { return c.overlap.other == map; }),
                        confirmations.end());
  }
}

OverlapDetection OverlapDetector::Detect(const Map& map, KeyFrameId current, const BowVector& bow,
                                         const std::vector<OtherMap>& others, const EnsureAppearance& ensure,
                                         StageTimes* times) {
  OverlapDetection detection;
  Memory& memory = memories_[map.id()];
  ++memory.round;
  auto& confirmations = memory.confirmations;
  while (!confirmations.empty() && memory.round - confirmations.front().round > options_.max_keyframes_apart)
    confirmations.pop_front();
  const Stopwatch stopwatch;
  const std::vector<const OtherMap*> maps = ChooseMaps(others, &memory);
  detection.maps = maps.size();
  for (const OtherMap* other : maps) detection.keyframes += other->num_keyframes();
  const std::vector<Found> candidates = FindConsistent(bow, maps, &memory, &detection);
  times->Add("lookup_words", stopwatch.Milliseconds());

  const std::vector<DetectedOverlap> verified = Verify(map, current, candidates, ensure, &memory, &detection, times);
  if (verified.empty()) return detection;
  const auto best = std::max_element(
      verified.begin(), verified.end(),
      [](const DetectedOverlap& a, const DetectedOverlap& b) { return a.place.group_inliers < b.place.group_inliers; });
  for (const DetectedOverlap& other : verified) {
    if (other.other != best->other || SayTheSame(map, *best, other)) continue;
    detection.refusals.push_back(
        {map.id(), best->other, current, best->matched,
         fmt::format("ambiguous: {} looks the same and lies elsewhere", ToString(other.matched))});
    return detection;
  }
  Confirm(map, *best, &memory, &detection);
  return detection;
}

/// The first map always; of the others those with mutual activity come first too, and the rest take turns when they are
/// too many.
std::vector<const OtherMap*> OverlapDetector::ChooseMaps(const std::vector<OtherMap>& others, Memory* memory) const {
  std::vector<const OtherMap*> chosen;
  size_t keyframes = 0;
  size_t next = 0;
  const auto take = [&](const OtherMap& other) {
    if (!chosen.empty() && keyframes + other.num_keyframes() > options_.max_looked_up) return false;
    keyframes += other.num_keyframes();
    chosen.push_back(&other);
    return true;
  };
  // Half of the room goes by order, the other half to those whose turn it is.
  while (next < others.size() && (next == 0 || 2 * keyframes < options_.max_looked_up) && take(others[next])) ++next;
  const size_t rest = others.size() - next;
  size_t taken = 0;
  while (taken < rest && take(others[next + (memory->turn + taken) % rest])) ++taken;
  if (rest == 0)
    memory->turn = 0;
  else if (memory->round % kTurn == 0)
    memory->turn = (memory->turn + taken) % rest;
  return chosen;
}

std::vector<KeyFrameId> OverlapDetector::GroupOf(const OtherMap& map, KeyFrameId keyframe) const {
  std::vector<KeyFrameId> group =
      map.neighbours(keyframe, options_.candidates.neighbours).value_or(std::vector<KeyFrameId>());
  group.push_back(keyframe);
  return group;
}

/// Candidates of all maps that belong to those of the keyframes before: each map's best first, that of the most active
/// map before all and then by score, as the same words were looked up in all maps; those refused with the last keyframe
/// behind.
std::vector<OverlapDetector::Found> OverlapDetector::FindConsistent(const BowVector& bow,
                                                                    const std::vector<const OtherMap*>& maps,
                                                                    Memory* memory, OverlapDetection* detection) const {
  struct Ranked {
    Found found;
    size_t place_in_map = 0, map = 0;
  };
  std::vector<Ranked> ranked;
  std::unordered_set<KeyFrameId> round;
  CandidateOptions options = options_.candidates;
  options.most_scored =
      std::min(options.most_scored, std::max(kMinScoredOfMap, kMaxScored / std::max<size_t>(maps.size(), 1)));
  const auto shared = QueryMaps(MostTelling(bow, kMaxWords / std::max<size_t>(maps.size(), 1)), maps);
  for (size_t m = 0; m < maps.size(); ++m) {
    const std::vector<Candidate> candidates = FindCandidates(shared[m], maps[m]->neighbours, options, nullptr);
    detection->candidates += static_cast<int>(candidates.size());
    for (size_t i = 0; i < candidates.size(); ++i) {
      const std::vector<KeyFrameId> group = GroupOf(*maps[m], candidates[i].keyframe);
      const auto is_in = [&](const std::unordered_set<KeyFrameId>& set) {
        return std::any_of(group.begin(), group.end(), [&](KeyFrameId id) { return set.count(id) == 1; });
      };
      if (options_.consistent_rounds == 0 || std::any_of(memory->rounds.begin(), memory->rounds.end(), is_in))
        ranked.push_back({{maps[m], candidates[i], is_in(memory->refused)}, i, m});
      round.insert(group.begin(), group.end());
    }
  }
  memory->rounds.push_back(std::move(round));
  while (static_cast<int>(memory->rounds.size()) > options_.consistent_rounds) memory->rounds.pop_front();
  std::stable_sort(ranked.begin(), ranked.end(), [](const Ranked& a, const Ranked& b) {
    return std::make_tuple(a.found.refused_before, a.place_in_map, a.map > 0, -a.found.candidate.accumulated_score) <
           std::make_tuple(b.found.refused_before, b.place_in_map, b.map > 0, -b.found.candidate.accumulated_score);
  });
  std::vector<Found> consistent;
  for (Ranked& r : ranked) consistent.push_back(std::move(r.found));
  GiveATurn(*memory, &consistent);
  detection->consistent = static_cast<int>(consistent.size());
  return consistent;
}

/// The last of those that will be verified is one whose map has waited for longest: every map gives candidates, seen or
/// not, and words alone must not keep one out for ever.
void OverlapDetector::GiveATurn(const Memory& memory, std::vector<Found>* candidates) const {
  if (options_.max_verified < 2 || candidates->size() <= static_cast<size_t>(options_.max_verified)) return;
  const auto last_round = [&](const Found& found) {
    const auto verified = memory.verified.find(found.other->id);
    return verified == memory.verified.end() ? 0 : verified->second;
  };
  const auto last = candidates->begin() + (options_.max_verified - 1);
  const auto longest = std::min_element(last, candidates->end(),
                                        [&](const Found& a, const Found& b) { return last_round(a) < last_round(b); });
  std::rotate(last, longest, longest + 1);
}

bool OverlapDetector::EnsureBoth(const Map& map, KeyFrameId current, const Map& other, KeyFrameId matched,
                                 const EnsureAppearance& ensure) const {
  if (!ensure) return true;
  const Sim3VerificationOptions& verification = options_.verification;
  return ensure(map, KeyFramesRead(map, current, verification.neighbourhood, verification.consistency_keyframes + 1)) &&
         ensure(other, KeyFramesRead(other, matched, verification.neighbourhood, verification.word_keyframes));
}

std::vector<DetectedOverlap> OverlapDetector::Verify(const Map& map, KeyFrameId current,
                                                     const std::vector<Found>& candidates,
                                                     const EnsureAppearance& ensure, Memory* memory,
                                                     OverlapDetection* detection, StageTimes* times) const {
  std::vector<DetectedOverlap> verified;
  std::unordered_set<KeyFrameId> refused;
  for (const Found& found : candidates) {
    if (detection->verified == options_.max_verified) break;
    const KeyFrameId matched = found.candidate.keyframe;
    const auto refuse = [&](const std::string& reason) {
      detection->refusals.push_back({map.id(), found.other->id, current, matched, reason});
    };
    const Map* opened = found.other->open();
    if (opened == nullptr || !EnsureBoth(map, current, *opened, matched, ensure)) {
      refuse(opened == nullptr ? "its map is still being read" : "its descriptors are still being read");
      continue;
    }
    const Map& other = *opened;
    ++detection->verified;
    memory->verified[other.id()] = memory->round;
    const Stopwatch stopwatch;
    auto place = VerifyPlace(map, current, other, matched, options_.verification, nullptr, times);
    times->Add("lookup_verify", stopwatch.Milliseconds());
    if (!place) {
      refuse(place.error().message);
      const std::vector<KeyFrameId> group = GroupOf(*found.other, matched);
      refused.insert(group.begin(), group.end());
      continue;
    }
    DetectedOverlap overlap{map.id(), other.id(), current, matched, std::move(*place), {}};
    overlap.other_from_map = Sim3d(other.keyframe(matched).camera_from_map).Inverse() *
                             overlap.place.query_from_candidate.Inverse() *
                             Sim3d(map.keyframe(current).camera_from_map);
    const bool is_known =
        std::any_of(memory->confirmations.begin(), memory->confirmations.end(), [&](const Confirmation& earlier) {
          return earlier.overlap.other == overlap.other && SayTheSame(map, overlap, earlier.overlap);
        });
    verified.push_back(std::move(overlap));
    if (is_known) break;  // what an earlier keyframe said too is not ambiguous
  }
  memory->refused = std::move(refused);
  return verified;
}

bool OverlapDetector::SayTheSame(const Map& map, const DetectedOverlap& a, const DetectedOverlap& b) const {
  const Eigen::Vector3d centre = map.keyframe(a.current).camera_from_map.TargetOriginInSource();
  return Agree(a.other_from_map, b.other_from_map, centre, map.MedianDepth(a.current), options_.agreement);
}

void OverlapDetector::Confirm(const Map& map, const DetectedOverlap& confirmed, Memory* memory,
                              OverlapDetection* detection) const {
  auto& confirmations = memory->confirmations;
  bool agrees = false;
  for (const Confirmation& earlier : confirmations) {
    if (earlier.overlap.other != confirmed.other) continue;
    agrees = SayTheSame(map, confirmed, earlier.overlap);
    if (agrees) continue;
    detection->refusals.push_back({confirmed.map, confirmed.other, confirmed.current, confirmed.matched,
                                   fmt::format("contradicts {} seen from {}", ToString(earlier.overlap.matched),
                                               ToString(earlier.overlap.current))});
    break;
  }
  confirmations.push_back({memory->round, confirmed});
  detection->confirmed = confirmed;
  if (agrees) detection->overlap = confirmed;
}

}  // namespace portolan
