#include "tracking/frame_history.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace portolan {

void FrameHistory::Add(const Map& map, const Frame& frame, bool online) {
  const KeyFrame* anchor = map.FindKeyFrame(frame.reference);
  if (anchor == nullptr) return;
  FrameRecord& record = records_[frame.number];
  record.frame = frame.number;
  record.stamp = frame.stamp;
  record.map = map.id();
  record.online_camera_from_map = frame.camera_from_map;
  record.online = online;
  record.camera_from_start = frame.camera_from_start;
  Anchor(&record, frame.reference, frame.camera_from_map * anchor->camera_from_map.Inverse());
}

void FrameHistory::Anchor(FrameRecord* record, KeyFrameId anchor, const Rigid3d& camera_from_anchor) {
  record->anchor = anchor;
  record->camera_from_anchor = camera_from_anchor;
  by_anchor_[anchor].push_back(record->frame);
  changed_.insert(record->frame);
}

void FrameHistory::Restore(const std::vector<FrameRecord>& records) {
  for (const FrameRecord& record : records) {
    records_[record.frame] = record;
    by_anchor_[record.anchor].push_back(record.frame);
  }
}

void FrameHistory::HangLooseFrames(const Map& map) {
  std::vector<uint64_t> loose, held;
  for (const auto& [number, record] : records_) {
    if (record.map == map.id()) (map.FindKeyFrame(record.anchor) == nullptr ? loose : held).push_back(number);
  }
  if (held.empty()) return;
  for (const uint64_t number : loose) {
    const auto after = std::lower_bound(held.begin(), held.end(), number);
    const bool is_after_nearer =
        after == held.begin() || (after != held.end() && *after - number < number - *std::prev(after));
    const FrameRecord& near = records_.at(is_after_nearer ? *after : *std::prev(after));
    FrameRecord& record = records_.at(number);
    Anchor(&record, near.anchor,
           record.online_camera_from_map * near.online_camera_from_map.Inverse() * near.camera_from_anchor);
  }
}

std::vector<FrameRecord> FrameHistory::TakeChanged() {
  std::vector<FrameRecord> changed;
  for (const uint64_t number : std::exchange(changed_, {})) changed.push_back(records_.at(number));
  return changed;
}

void FrameHistory::NoteKeyFrame(uint64_t frame, KeyFrameId keyframe) {
  own_frame_[keyframe] = frame;
}

void FrameHistory::OnDelta(const Map& map, const MapDelta& delta) {
  for (const MapDelta::KeyFrameState& state : delta.keyframes) {
    const auto own = own_frame_.find(state.id);
    if (own == own_frame_.end()) continue;
    const auto record = records_.find(own->second);
    if (record != records_.end() && record->second.map == map.id()) Anchor(&record->second, state.id, Rigid3d());
    own_frame_.erase(own);
  }
  for (const MapDelta::RemovedKeyFrame& removed : delta.removed_keyframes) PassOn(map.id(), removed);
}

void FrameHistory::PassOn(MapId map, const MapDelta::RemovedKeyFrame& removed) {
  const auto hung = by_anchor_.find(removed.id);
  if (hung == by_anchor_.end()) return;
  std::vector<uint64_t> staying;
  for (const uint64_t frame : std::exchange(hung->second, {})) {
    FrameRecord& record = records_[frame];
    if (record.anchor != removed.id) continue;  // it has been hung elsewhere since
    if (record.map == map) {
      Anchor(&record, removed.anchor, record.camera_from_anchor * removed.removed_from_anchor);
    } else {
      staying.push_back(frame);
    }
  }
  if (staying.empty()) {
    by_anchor_.erase(removed.id);
  } else {
    by_anchor_[removed.id] = std::move(staying);
    removed_early_[map].push_back(removed);
  }
}

void FrameHistory::Fuse(MapId map, MapId other, const Sim3d& map_from_other) {
  for (auto& [number, record] : records_) {
    if (record.map != other) continue;
    record.map = map;
    record.camera_from_anchor.translation *= map_from_other.scale;  // lengths in `map`'s units
    record.online_camera_from_map = TransformPose(record.online_camera_from_map, map_from_other);
    changed_.insert(number);
  }
  const auto early = removed_early_.find(map);
  if (early == removed_early_.end()) return;
  const std::vector<MapDelta::RemovedKeyFrame> removed = std::move(early->second);
  removed_early_.erase(early);
  for (const MapDelta::RemovedKeyFrame& keyframe : removed) PassOn(map, keyframe);
}

std::optional<Rigid3d> FrameHistory::CameraFromMap(const Map& map, const FrameRecord& record) {
  const KeyFrame* anchor = map.FindKeyFrame(record.anchor);
  if (anchor == nullptr) return std::nullopt;
  return record.camera_from_anchor * anchor->camera_from_map;
}

}  // namespace portolan
