#include "mapping/local_mapper.h"

#include <algorithm>
#include <climits>
#include <string>
#include <unordered_set>

#include "base/time.h"
#include "map_optimization/map_correction.h"
#include "map_optimization/map_fusion.h"
#include "mapping/map_initialization.h"
#include "mapping/point_creation.h"
#include "optimization/pose_optimization.h"
#include "place_recognition/landmark_search.h"

namespace portolan {
namespace {

// Of a keyframe's landmarks: with fewer in the map, it is not the map that the keyframe was tracked in.
constexpr double kMinKnownShare = 0.5;
constexpr size_t kKeyFramesAround = 10;  // of the reference: as many as new points and duplicates are looked for in
constexpr double kPoseRadiusPx = 10.0;   // the map has moved a little since the pose was found

}  // namespace

/// What the tracker saw, as far as it still exists: matches and, in the same order, what they are matches of.
struct LocalMapper::TrackedLandmarks {
  PoseMatches matches;
  std::vector<std::pair<uint32_t, MapPointId>> sources;

  void Add(const KeyFrameData& data, uint32_t feature, const MapPoint& point) {
    sources.emplace_back(feature, point.id);
    matches.landmarks_in_map.push_back(point.position_in_map.cast<double>());
    matches.pixels_px.push_back(data.features.pixels_px[feature].cast<double>());
    matches.sigmas_px.push_back(data.pyramid.Sigma(data.features.octaves[feature]));
  }
};

LocalMapper::LocalMapper(const MapperOptions& options, MapId map, Epoch epoch, IdMinter<MapPointId>* point_ids,
                         Publish publish)
    : LocalMapper(options, Map(map, epoch), epoch, point_ids, std::move(publish)) {}

LocalMapper::LocalMapper(const MapperOptions& options, Map map, Epoch epoch, IdMinter<MapPointId>* point_ids,
                         Publish publish)
    : options_(options),
      map_(std::move(map)),
      point_ids_(point_ids),
      publish_(std::move(publish)),
      probation_(options.pruning),
      next_lens_refinement_(options.lens.enabled && map_.keyframes().empty() ? options.lens.first_keyframes : INT_MAX) {
  map_.SetEpoch(epoch);
}

Status LocalMapper::Initialize(KeyFramePtr first, KeyFramePtr second, const KeyFrameMessage& message) {
  if (!map_.keyframes().empty()) return Error{"map " + ToString(map_.id()) + " is initialised already"};
  if (first->id == second->id) return Error{"map initialisation: both keyframes are " + ToString(first->id)};
  if (first->stamp.ns != witnessed_first_.ns) plane_witness_.Clear();  // sent again it has another id
  witnessed_first_ = first->stamp;
  const auto structure = ReconstructInitialStructure(*first, *second, message.initial_matches, options_.initialization,
                                                     message.camera_from_map, &plane_witness_);
  if (!structure.ok()) return structure.error();
  const KeyFrameId first_id = first->id, second_id = second->id;
  map_.AddKeyFrame(std::move(first), Rigid3d(), KeyFrameId());
  map_.AddKeyFrame(std::move(second), structure->second_from_first, first_id);
  for (const InitialStructure::Point& point : structure->points) {
    const MapPointId id = point_ids_->Next();
    map_.AddPoint(id, point.position_in_first.cast<float>());
    map_.AddObservation(id, first_id, point.first_feature);
    map_.AddObservation(id, second_id, point.second_feature);
  }
  map_.RefreshDerived();
  newest_ = second_id;
  PublishChanges();
  return Ok{};
}

Status LocalMapper::Process(KeyFramePtr data, const KeyFrameMessage& message, const MoreWorkWaits& more_work_waits,
                            const std::atomic<bool>* stop) {
  if (Status inserted = InsertKeyFrame(std::move(data), message); !inserted.ok()) return inserted;
  PublishChanges();
  DropFailedPoints();
  ExtendMap(more_work_waits);
  PublishChanges();
  if (!more_work_waits()) {
    FuseDuplicates();
    PublishChanges();
  }
  if (!more_work_waits()) {
    OptimizeLocally(stop);
    PublishChanges();
  }
  Prune();
  PublishChanges();
  return Ok{};
}

LocalMapper::TrackedLandmarks LocalMapper::FindLandmarks(const KeyFrameData& data,
                                                         const KeyFrameMessage& message) const {
  TrackedLandmarks tracked;
  std::vector<bool> feature_used(data.features.size());
  std::unordered_set<MapPointId> point_used;
  for (const auto& [feature, landmark] : message.landmarks) {
    const MapPoint* point = map_.FindPoint(merged_points_.Follow(landmark));
    if (point == nullptr || feature >= data.features.size() || feature_used[feature] ||
        !point_used.insert(point->id).second)
      continue;
    feature_used[feature] = true;
    tracked.Add(data, feature, *point);
  }
  return tracked;
}

/// A keyframe that comes again, because this map is older than the one it was tracked in, finds what it saw under other
/// names, or not at all yet. The landmarks around its reference are where its pose puts them all the same.
void LocalMapper::FindByPose(const KeyFrameData& data, KeyFrameId reference, const Rigid3d& camera_from_map,
                             TrackedLandmarks* tracked) const {
  std::unordered_set<uint32_t> features;
  std::unordered_set<MapPointId> points;
  for (const auto& [feature, point] : tracked->sources) {
    features.insert(feature);
    points.insert(point);
  }
  std::vector<KeyFrameId> keyframes{reference};
  for (const auto& [id, common] : map_.CovisibleKeyFrames(reference, 1, kKeyFramesAround)) keyframes.push_back(id);
  std::vector<const MapPoint*> landmarks;
  for (const MapPointId id : LandmarksOf(map_, keyframes)) {
    if (points.count(id) == 0) landmarks.push_back(&map_.point(id));
  }
  LandmarkSearchOptions search;
  search.radius_px = kPoseRadiusPx;
  for (const FoundLandmark& found : portolan::FindLandmarks(landmarks, camera_from_map, data, search).found) {
    if (features.insert(found.feature).second) tracked->Add(data, found.feature, *landmarks[found.landmark]);
  }
}

Status LocalMapper::InsertKeyFrame(KeyFramePtr data, const KeyFrameMessage& message) {
  const Stopwatch watch;
  const KeyFrameId id = data->id;
  const std::string name = "keyframe " + ToString(id);
  if (map_.FindKeyFrame(id) != nullptr) return Error{name + " is in the map already"};
  const KeyFrameId reference = removed_keyframes_.Follow(message.reference);
  if (map_.FindKeyFrame(reference) == nullptr)
    return Error{name + ": its reference " + ToString(message.reference) + " is unknown"};
  TrackedLandmarks tracked = FindLandmarks(*data, message);
  if (kMinKnownShare * static_cast<double>(message.landmarks.size()) > static_cast<double>(tracked.sources.size())) {
    FindByPose(*data, reference, message.camera_from_map, &tracked);
  }
  const PoseOptimizationResult refined = OptimizePose(data->camera, tracked.matches, message.camera_from_map);
  if (refined.num_inliers < options_.min_landmarks) {
    return Error{
        name + ": " + std::to_string(refined.num_inliers) + " of its " + std::to_string(message.landmarks.size()) +
        " landmarks are in the map and agree with it, expected at least " + std::to_string(options_.min_landmarks)};
  }
  map_.AddKeyFrame(std::move(data), refined.camera_from_map, reference);
  for (size_t k = 0; k < tracked.sources.size(); ++k) {
    if (refined.inliers[k]) map_.AddObservation(tracked.sources[k].second, id, tracked.sources[k].first);
  }
  const auto covisible = map_.CovisibleKeyFrames(id, 1, 1);
  if (!covisible.empty()) map_.SetParent(id, covisible.front().first);
  map_.RefreshDerived();
  newest_ = id;
  stage_times_.Add("insert", watch.Milliseconds());
  return Ok{};
}

int LocalMapper::DropFailedPoints() {
  const std::vector<MapPointId> failed = probation_.Judge(map_, newest_);
  for (const MapPointId id : failed) map_.RemovePoint(id);
  return static_cast<int>(failed.size());
}

int LocalMapper::ExtendMap(const MoreWorkWaits& more_work_waits) {
  const Stopwatch watch;
  int created = 0, searched = 0;
  // The paper takes the closest keyframe alone; more of them find more points, and with wider baselines.
  for (const auto& [neighbour, common] :
       map_.CovisibleKeyFrames(newest_, 1, static_cast<size_t>(options_.creation.neighbours))) {
    if (searched++ >= options_.creation.min_neighbours && more_work_waits()) break;
    const std::vector<MapPointId> points = CreatePoints(&map_, newest_, neighbour, options_.creation, point_ids_);
    probation_.Add(points);
    created += static_cast<int>(points.size());
  }
  map_.RefreshDerived();
  stage_times_.Add("extend", watch.Milliseconds());
  return created;
}

FusionResult LocalMapper::FuseDuplicates() {
  const Stopwatch watch;
  FusionResult fused = FuseWithNeighbours(&map_, newest_, options_.fusion);
  NoteMerges(fused.merges);
  stage_times_.Add("fuse", watch.Milliseconds());
  return fused;
}

LocalBundleResult LocalMapper::OptimizeLocally(const std::atomic<bool>* stop) {
  const Stopwatch watch;
  const LocalBundleResult result = OptimizeLocalWindow(&map_, newest_, options_.bundle, stop);
  stage_times_.Add("local_ba", watch.Milliseconds());
  return result;
}

std::vector<KeyFrameId> LocalMapper::Prune() {
  const Stopwatch watch;
  for (const MapPointId id : FindUnreliablePoints(map_, newest_, options_.pruning)) map_.RemovePoint(id);
  std::vector<KeyFrameId> pruned;
  for (const auto& [removed, parent] : PruneKeyFrames(&map_, newest_, options_.pruning)) {
    removed_keyframes_.Note(removed, parent);
    pruned.push_back(removed);
  }
  stage_times_.Add("prune", watch.Milliseconds());
  return pruned;
}

std::optional<LensProblem> LocalMapper::NextLensProblem() {
  const auto keyframes = static_cast<int>(map_.keyframes().size());
  if (keyframes < next_lens_refinement_ || keyframes > options_.lens.max_keyframes) return std::nullopt;
  next_lens_refinement_ = static_cast<int>(options_.lens.growth * keyframes);
  return MakeLensProblem(map_, options_.lens);
}

void LocalMapper::TakeLensFinding(const LensFinding& finding) {
  if (finding.is_settled) next_lens_refinement_ = INT_MAX;
}

Status LocalMapper::TakeResidual(const CameraResidual& known, const MapCorrection& adaptation) {
  if (adaptation.made_from_revision < corrected_revision_) return Error{"the map was corrected meanwhile"};
  if (const auto applied = ApplyMapCorrection(adaptation, &map_); !applied.ok()) return applied.error();
  map_.SetResidual(known.camera, known.residual);
  PublishChanges();
  last_residual_ = map_.revision();
  return Ok{};
}

void LocalMapper::PublishChanges() {
  MapDelta delta = map_.TakeDelta();
  if (!delta.IsEmpty()) publish_(std::move(delta));
}

void LocalMapper::PublishSnapshot() {
  PublishChanges();
  publish_(map_.Snapshot());
}

Status LocalMapper::ApplyCorrection(const MapCorrection& correction) {
  if (correction.made_from_revision < last_residual_)
    return Error{"it was made before the calibration's residual was taken out"};
  // Its poses are absolute: they would undo the other's. A fusion moves nothing of this map: what it brought follows.
  if (correction.made_from_revision < moved_revision_) {
    return Error{"it was made from revision " + std::to_string(correction.made_from_revision) +
                 ", the map was corrected at " + std::to_string(moved_revision_)};
  }
  const auto merges = ApplyMapCorrection(correction, &map_);
  if (!merges.ok()) return merges.error();
  NoteMerges(merges.value());
  PublishChanges();
  corrected_revision_ = moved_revision_ = map_.revision();
  return Ok{};
}

Status LocalMapper::TakeIn(const LocalMapper& other, const MapCorrection& fusion) {
  if (const Revision changed = std::max(corrected_revision_, last_residual_); fusion.made_from_revision < changed) {
    return Error{"fusion of " + ToString(fusion.other) + " into " + ToString(map_.id()) + ": made from revision " +
                 std::to_string(fusion.made_from_revision) + ", the map was corrected at " + std::to_string(changed)};
  }
  const auto merges = ApplyFusion(fusion, other.map_, &map_);
  if (!merges.ok()) return merges.error();
  merged_points_.Add(other.merged_points_);
  removed_keyframes_.Add(other.removed_keyframes_);
  NoteMerges(merges.value());
  PublishChanges();
  corrected_revision_ = map_.revision();
  return Ok{};
}

void LocalMapper::NoteMerges(const std::vector<std::pair<MapPointId, MapPointId>>& merges) {
  for (const auto& [from, into] : merges) merged_points_.Note(from, into);
}

}  // namespace portolan
