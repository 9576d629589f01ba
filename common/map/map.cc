#include "map/map.h"

#include <algorithm>
#include <utility>

#include "base/check.h"

namespace portolan {
namespace {

std::vector<Observation>::const_iterator LowerBound(const std::vector<Observation>& observations, KeyFrameId keyframe) {
  return std::lower_bound(observations.begin(), observations.end(), keyframe,
                          [](const Observation& o, KeyFrameId id) { return o.keyframe < id; });
}

}  // namespace

const Observation* MapPoint::FindObservation(KeyFrameId keyframe) const {
  const auto found = LowerBound(observations, keyframe);
  return found != observations.end() && found->keyframe == keyframe ? &*found : nullptr;
}

void MapPoint::InsertObservation(const Observation& observation) {
  const bool is_last = observations.empty() || observations.back().keyframe < observation.keyframe;  // most are
  observations.insert(is_last ? observations.end() : LowerBound(observations, observation.keyframe), observation);
}

std::vector<MapPointId> Map::SortedPointIds() const {
  std::vector<MapPointId> ids;
  ids.reserve(points_.size());
  for (const auto& [id, point] : points_) ids.push_back(id);
  std::sort(ids.begin(), ids.end());
  return ids;
}

const KeyFrame* Map::FindKeyFrame(KeyFrameId id) const {
  const auto found = keyframes_.find(id);
  return found == keyframes_.end() ? nullptr : &found->second;
}

const MapPoint* Map::FindPoint(MapPointId id) const {
  const auto found = points_.find(id);
  return found == points_.end() ? nullptr : &found->second;
}

const KeyFrame& Map::keyframe(KeyFrameId id) const {
  const KeyFrame* found = FindKeyFrame(id);
  PORTOLAN_CHECK(found != nullptr) << "no keyframe " << id << " in map " << id_;
  return *found;
}

const MapPoint& Map::point(MapPointId id) const {
  const MapPoint* found = FindPoint(id);
  PORTOLAN_CHECK(found != nullptr) << "no point " << id << " in map " << id_;
  return *found;
}

KeyFrame& Map::MutableKeyFrame(KeyFrameId id) {
  return const_cast<KeyFrame&>(keyframe(id));
}
MapPoint& Map::MutablePoint(MapPointId id) {
  return const_cast<MapPoint&>(point(id));
}

void Map::AddKeyFrame(std::shared_ptr<const KeyFrameData> data, const Rigid3d& camera_from_map, KeyFrameId parent) {
  PORTOLAN_CHECK(data != nullptr && data->id.IsValid());
  PORTOLAN_CHECK(!parent.IsValid() || keyframes_.count(parent) == 1) << "parent " << parent << " is not in map " << id_;
  const KeyFrameId id = data->id;
  data = WithKnownResidual(std::move(data));
  KeyFrame keyframe;
  keyframe.landmarks = KeyFrameLandmarks(data->features.size());
  keyframe.data = std::move(data);
  keyframe.camera_from_map = camera_from_map;
  keyframe.parent = parent;
  const bool is_new = keyframes_.emplace(id, std::move(keyframe)).second;
  PORTOLAN_CHECK(is_new) << "keyframe " << id << " is already in map " << id_;
  changes_.keyframes.insert(id);
}

void Map::SetResidual(const PinholeCamera& camera, const RadialResidual& residual) {
  PORTOLAN_CHECK(IsSound(residual));
  std::vector<CameraResidual> residuals = residuals_;
  const auto is_of = [&](const CameraResidual& known) { return known.camera == camera; };
  residuals.erase(std::remove_if(residuals.begin(), residuals.end(), is_of), residuals.end());
  residuals.push_back({camera, residual});
  TakeResiduals(std::move(residuals));
  // A change without elements would be no delta.
  for (const auto& [id, keyframe] : keyframes_) changes_.keyframes.insert(id);
}

void Map::TakeResiduals(std::vector<CameraResidual> residuals) {
  residuals_ = std::move(residuals);
  for (auto& [id, keyframe] : keyframes_) keyframe.data = WithKnownResidual(keyframe.data);
}

std::shared_ptr<const KeyFrameData> Map::WithKnownResidual(std::shared_ptr<const KeyFrameData> data) const {
  for (const CameraResidual& known : residuals_) {
    if (known.camera == data->camera) return WithResidual(data, known.residual);
  }
  return data;
}

void Map::SetPose(KeyFrameId id, const Rigid3d& camera_from_map) {
  KeyFrame& keyframe = MutableKeyFrame(id);
  keyframe.camera_from_map = camera_from_map;
  moved_keyframes_.insert(id);
  changes_.keyframes.insert(id);
}

void Map::SetParent(KeyFrameId id, KeyFrameId parent) {
  PORTOLAN_CHECK(id != parent);
  MutableKeyFrame(id).parent = parent;
  changes_.keyframes.insert(id);
}

void Map::RemoveKeyFrame(KeyFrameId id) {
  const KeyFrame removed = keyframe(id);
  PORTOLAN_CHECK(removed.parent.IsValid()) << "the first keyframe of a map can't be removed";
  std::vector<MapPointId> orphans;
  for (const MapPointId landmark : removed.landmarks) {
    RemoveObservation(landmark, id);
    if (point(landmark).observations.size() < 2) orphans.push_back(landmark);
  }
  for (const MapPointId orphan : orphans) RemovePoint(orphan);
  for (const KeyFrameId child : Children(id)) SetParent(child, removed.parent);
  const Rigid3d removed_from_anchor =
      removed.camera_from_map * MutableKeyFrame(removed.parent).camera_from_map.Inverse();
  keyframes_.erase(id);
  covisibility_.Forget(id);
  changes_.keyframes.erase(id);
  changes_.removed_keyframes.push_back({id, removed.parent, removed_from_anchor});
}

void Map::AddPoint(MapPointId id, const Eigen::Vector3f& position_in_map) {
  PORTOLAN_CHECK(id.IsValid() && position_in_map.allFinite());
  MapPoint point;
  point.id = id;
  point.position_in_map = position_in_map;
  const bool is_new = points_.emplace(id, std::move(point)).second;
  PORTOLAN_CHECK(is_new) << "point " << id << " is already in map " << id_;
  changes_.points.insert(id);
}

void Map::SetPosition(MapPointId id, const Eigen::Vector3f& position_in_map) {
  PORTOLAN_CHECK(position_in_map.allFinite());
  MapPoint& point = MutablePoint(id);
  point.position_in_map = position_in_map;
  MarkStale(&point, kGeometryStale);
  changes_.points.insert(id);
}

void Map::RemovePoint(MapPointId id) {
  ErasePoint(id, MapPointId());
}

void Map::ErasePoint(MapPointId id, MapPointId replaced_by) {
  MapPoint& point = MutablePoint(id);
  UnlinkAll(&point);
  points_.erase(id);
  changes_.points.erase(id);
  // What was seen of a point goes with it: no need to say so observation by observation.
  const auto first = changes_.observations.lower_bound({id, KeyFrameId()});
  auto last = first;
  while (last != changes_.observations.end() && last->first.first == id) ++last;
  changes_.observations.erase(first, last);
  changes_.removed_points.push_back({id, replaced_by});
}

void Map::MergePoints(MapPointId from, MapPointId into) {
  PORTOLAN_CHECK(from != into);
  const std::vector<Observation> observations = point(from).observations;
  PORTOLAN_CHECK(FindPoint(into) != nullptr) << "no point " << into;
  ErasePoint(from, into);
  for (const Observation& o : observations) AddObservation(into, o.keyframe, o.feature);
}

bool Map::AddObservation(MapPointId point_id, KeyFrameId keyframe_id, uint32_t feature) {
  MapPoint& point = MutablePoint(point_id);
  KeyFrame& keyframe = MutableKeyFrame(keyframe_id);
  PORTOLAN_CHECK(feature < keyframe.landmarks.num_features())
      << "feature " << feature << " of keyframe " << keyframe_id;
  if (keyframe.landmarks[feature].IsValid() || point.FindObservation(keyframe_id) != nullptr) return false;
  LinkObservation(&point, keyframe_id, feature);
  changes_.observations[{point_id, keyframe_id}] = static_cast<int32_t>(feature);
  return true;
}

void Map::RemoveObservation(MapPointId point_id, KeyFrameId keyframe_id) {
  MapPoint& point = MutablePoint(point_id);
  const Observation* observation = point.FindObservation(keyframe_id);
  if (observation == nullptr) return;
  UnlinkObservation(&point, static_cast<size_t>(observation - point.observations.data()));
  changes_.observations[{point_id, keyframe_id}] = -1;
}

void Map::LinkObservation(MapPoint* point, KeyFrameId keyframe, uint32_t feature) {
  for (const Observation& o : point->observations) covisibility_.Add(keyframe, o.keyframe);
  point->InsertObservation({keyframe, feature});
  MutableKeyFrame(keyframe).landmarks.Set(feature, point->id);
  MarkStale(point, kGeometryStale | kDescriptorStale);
}

void Map::UnlinkObservation(MapPoint* point, size_t index) {
  const Observation removed = point->observations[index];
  point->observations.erase(point->observations.begin() + static_cast<ptrdiff_t>(index));
  MutableKeyFrame(removed.keyframe).landmarks.Set(removed.feature, MapPointId());
  for (const Observation& o : point->observations) covisibility_.Remove(removed.keyframe, o.keyframe);
  MarkStale(point, kGeometryStale | kDescriptorStale);
}

void Map::UnlinkAll(MapPoint* point) {
  while (!point->observations.empty()) UnlinkObservation(point, point->observations.size() - 1);
}

int Map::Covisibility(KeyFrameId a, KeyFrameId b) const {
  return covisibility_.Common(a, b);
}

std::vector<std::pair<KeyFrameId, int>> Map::CovisibleKeyFrames(KeyFrameId id, int min_common, size_t most) const {
  const CovisibilityGraph::Neighbours& neighbours = covisibility_.Of(id);
  std::vector<std::pair<KeyFrameId, int>> best(most > 0 ? std::min(most, neighbours.size()) : neighbours.size());
  std::partial_sort_copy(
      neighbours.begin(), neighbours.end(), best.begin(), best.end(),
      [](const auto& a, const auto& b) { return a.second != b.second ? a.second > b.second : a.first < b.first; });
  while (!best.empty() && best.back().second < min_common) best.pop_back();
  return best;
}

std::vector<KeyFrameId> Map::Children(KeyFrameId id) const {
  std::vector<KeyFrameId> children;
  for (const auto& [child, keyframe] : keyframes_) {
    if (keyframe.parent == id) children.push_back(child);
  }
  return children;
}

double Map::MedianDepth(KeyFrameId id) const {
  const KeyFrame& keyframe = this->keyframe(id);
  std::vector<double> depths;
  for (const MapPointId landmark : keyframe.landmarks) {
    depths.push_back((keyframe.camera_from_map * points_.at(landmark).position_in_map.cast<double>()).z());
  }
  if (depths.empty()) return 0;
  const auto middle = depths.begin() + static_cast<ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

}  // namespace portolan
