#include "atlas/map_saver.h"

#include <algorithm>

#include "map/map_changes.h"

namespace portolan {

bool MapSaver::IsSaved(const Map& map) const {
  const auto saved = saved_.find(map.id());
  return map.revision() == 0 || (saved != saved_.end() && saved->second.state == StateOf(map));
}

bool MapSaver::IsComplete(const std::map<MapId, MapReplica>& replicas) const {
  for (const auto& [id, replica] : replicas) {
    if (!IsSaved(replica.map())) return false;
  }
  return true;
}

void MapSaver::OnApplied(const MapDelta& delta) {
  std::vector<MapDelta>& waiting = saved_[delta.map].waiting;
  const bool goes_on = waiting.empty() ? store_.CanAppend(delta)
                                       : Continues(delta, waiting.back().epoch, waiting.back().revision) &&
                                             waiting.size() < kMostWaiting;
  if (!goes_on) return waiting.clear();
  waiting.push_back(delta);
}

Result<bool> MapSaver::Step(const std::map<MapId, MapReplica>& replicas, double now_s) {
  auto next = replicas.upper_bound(last_);  // in turns: a map that grows fast leaves the others theirs
  for (size_t i = 0; i < replicas.size(); ++i, ++next) {
    if (next == replicas.end()) next = replicas.begin();
    const Map& map = next->second.map();
    if (map.revision() == 0) continue;
    const Result<bool> written = StepMap(map, now_s);
    if (written && !*written) continue;
    last_ = map.id();
    return written;
  }
  return false;
}

/// Few new keyframes and what changed with them go in one step: where keyframes come faster than steps, changes would
/// never have their turn.
Result<bool> MapSaver::StepMap(const Map& map, double now_s) {
  const Saved& saved = saved_[map.id()];
  const auto missing = MissingKeyFrames(map);
  if (!missing.empty()) {
    if (Status done = SaveKeyFrames(map, missing); !done) return done.error();
    if (missing.size() == kKeyFramesAStep) return true;
  }
  Status done = Ok{};
  if (IsStateDue(map, saved, now_s)) {
    done = SaveState(map, now_s);
  } else if (!IsSaved(map) && MayAppend(map, saved) && now_s - saved.changes_s >= interval_s_) {
    done = SaveChanges(map, now_s);
  } else {
    return !missing.empty();
  }
  if (!done) return done.error();
  return true;
}

/// Changes that lead to the map as it is. A keyframe that came and went between two pieces is in them and was not
/// stored: then they can't be.
bool MapSaver::MayAppend(const Map& map, const Saved& saved) const {
  if (saved.waiting.empty() || State(saved.waiting.back().epoch, saved.waiting.back().revision) != StateOf(map))
    return false;
  return std::all_of(saved.waiting.begin(), saved.waiting.end(), [this](const MapDelta& change) {
    return std::all_of(change.keyframes.begin(), change.keyframes.end(),
                       [this](const auto& state) { return store_.HasKeyFrame(state.id); });
  });
}

bool MapSaver::IsStateDue(const Map& map, const Saved& saved, double now_s) const {
  if (now_s - saved.state_s < kStateIntervalS) return false;
  if (!IsSaved(map) && !MayAppend(map, saved)) return true;
  const auto [state_bytes, change_bytes] = store_.SizesOf(map.id());
  if (change_bytes == 0) return false;
  const bool rests = IsSaved(map) && now_s - saved.changes_s >= kRestS;
  return rests || change_bytes > std::max(kMostChangeBytes, state_bytes / 2);
}

std::vector<std::shared_ptr<const KeyFrameData>> MapSaver::MissingKeyFrames(const Map& map) const {
  std::vector<std::shared_ptr<const KeyFrameData>> missing;
  if (IsSaved(map)) return missing;
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (missing.size() == kKeyFramesAStep) break;
    if (!store_.HasKeyFrame(id)) missing.push_back(keyframe.data);
  }
  return missing;
}

Status MapSaver::SaveKeyFrames(const Map& map, const std::vector<std::shared_ptr<const KeyFrameData>>& keyframes) {
  Status done = store_.SaveKeyFrames(keyframes);
  if (!done) return done;
  for (const auto& data : keyframes) stored_.emplace_back(map.id(), data->id);
  return done;
}

Status MapSaver::SaveChanges(const Map& map, double now_s) {
  Saved& saved = saved_[map.id()];
  saved.changes_s = now_s;
  Status done = store_.SaveChanges(saved.waiting);
  if (!done) return done;
  saved.waiting.clear();
  saved.state = StateOf(map);
  return done;
}

Status MapSaver::SaveState(const Map& map, double now_s) {
  Saved& saved = saved_[map.id()];
  saved.state_s = now_s;
  Status done = store_.SaveMap(map.Snapshot());
  if (!done) return done;
  saved.waiting.clear();
  saved.state = StateOf(map);
  return done;
}

Status MapSaver::SaveAll(const std::map<MapId, MapReplica>& replicas, double now_s,
                         const std::function<void()>& between) {
  for (const auto& [id, replica] : replicas) {
    const Map& map = replica.map();
    for (auto missing = MissingKeyFrames(map); !missing.empty(); missing = MissingKeyFrames(map)) {
      if (Status done = SaveKeyFrames(map, missing); !done) return done;
      between();
    }
    if (IsSaved(map) && store_.SizesOf(id).change_bytes == 0) continue;
    if (Status done = SaveState(map, now_s); !done) return done;
    between();
  }
  return Ok{};
}

}  // namespace portolan
