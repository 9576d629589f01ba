#include "atlas/map_saver.h"

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

Status MapSaver::Step(const std::map<MapId, MapReplica>& replicas, double now_s, double interval_s) {
  for (const auto& [id, replica] : replicas) {
    const Map& map = replica.map();
    if (IsSaved(map)) continue;
    std::vector<std::shared_ptr<const KeyFrameData>> missing;
    for (const auto& [keyframe_id, keyframe] : map.keyframes()) {
      if (missing.size() == kKeyFramesAStep) break;
      if (!store_.HasKeyFrame(keyframe_id)) missing.push_back(keyframe.data);
    }
    if (!missing.empty()) return SaveKeyFrames(map, missing);
    if (saved_.count(id) == 0 || now_s - saved_.at(id).time_s >= interval_s) return SaveState(map, now_s);
  }
  return Ok{};
}

Status MapSaver::SaveKeyFrames(const Map& map, const std::vector<std::shared_ptr<const KeyFrameData>>& keyframes) {
  Status done = store_.SaveKeyFrames(keyframes);
  if (!done) return done;
  for (const auto& data : keyframes) stored_.emplace_back(map.id(), data->id);
  return done;
}

Status MapSaver::SaveState(const Map& map, double now_s) {
  Saved& saved = saved_[map.id()];
  saved.time_s = now_s;
  Status done = store_.SaveMap(map.Snapshot());
  if (done) saved.state = StateOf(map);
  return done;
}

Status MapSaver::SaveAll(const std::map<MapId, MapReplica>& replicas, double now_s,
                         const std::function<void()>& between) {
  while (!IsComplete(replicas)) {
    if (Status done = Step(replicas, now_s, 0); !done) return done;
    between();
  }
  return Ok{};
}

}  // namespace portolan
