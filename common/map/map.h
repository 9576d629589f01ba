#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "map/covisibility_graph.h"
#include "map/keyframe.h"
#include "map/map_delta.h"
#include "map/map_point.h"

namespace portolan {

/// A map: keyframes, landmarks and who sees what. Elements are values, links are ids. Changed by its owner through the
/// methods below, which note what changed for TakeDelta(), or, as a replica, by Apply() alone. Not thread-safe: one
/// thread owns it.
///
///   Map map(map_id);
///   map.AddKeyFrame(data, camera_from_map, parent);
///   map.AddPoint(point_id, position);  map.AddObservation(point_id, keyframe_id, feature);
///   MapDelta delta = map.TakeDelta();            // the owner publishes it
///   replica.Apply(delta, find_keyframe_data);    // everyone else follows
class Map {
 public:
  explicit Map(MapId id = MapId(), Epoch epoch = 0) : id_(id), epoch_(epoch) {}

  MapId id() const { return id_; }
  Epoch epoch() const { return epoch_; }
  Revision revision() const { return revision_; }
  /// What is known of the cameras' calibrations. Keyframes of other cameras have out what their data says.
  const std::vector<CameraResidual>& residuals() const { return residuals_; }
  /// A new owner goes on with the map under a new epoch; revisions go on rising.
  void SetEpoch(Epoch epoch) { epoch_ = epoch; }

  const std::map<KeyFrameId, KeyFrame>& keyframes() const { return keyframes_; }
  const std::unordered_map<MapPointId, MapPoint>& points() const { return points_; }
  /// Ids of all points in ascending order, for work whose result must not depend on the hash table's order.
  std::vector<MapPointId> SortedPointIds() const;

  const KeyFrame* FindKeyFrame(KeyFrameId id) const;
  const MapPoint* FindPoint(MapPointId id) const;
  /// The same for ids that must be there; a check fails otherwise.
  const KeyFrame& keyframe(KeyFrameId id) const;
  const MapPoint& point(MapPointId id) const;

  // Changes by the owner. Ids given must exist unless said otherwise.
  /// Its features are taken as they are without the residual that is known of its camera, whatever the data had taken
  /// out (WithResidual).
  void AddKeyFrame(std::shared_ptr<const KeyFrameData> data, const Rigid3d& camera_from_map, KeyFrameId parent);
  /// What a camera's calibration left, found later than its first keyframes were made: the data of all its keyframes is
  /// replaced by what it is without it, here and, with the next delta, in every replica. Poses and positions stay.
  void SetResidual(const PinholeCamera& camera, const RadialResidual& residual);
  void SetPose(KeyFrameId id, const Rigid3d& camera_from_map);
  void SetParent(KeyFrameId id, KeyFrameId parent);
  /// Removes it and its observations; points left with fewer than two observations go too. Children hang on its parent
  /// afterwards (the first keyframe, which has none, can't be removed).
  void RemoveKeyFrame(KeyFrameId id);
  void AddPoint(MapPointId id, const Eigen::Vector3f& position_in_map);
  void SetPosition(MapPointId id, const Eigen::Vector3f& position_in_map);
  void RemovePoint(MapPointId id);
  /// `from` disappears; its observations become those of `into` where neither the keyframe sees `into` nor the feature
  /// is taken.
  void MergePoints(MapPointId from, MapPointId into);
  /// No effect, and false, if the keyframe sees the point already or the feature is another landmark's.
  bool AddObservation(MapPointId point, KeyFrameId keyframe, uint32_t feature);
  /// No effect if there is none. The point stays even without observations: the caller prunes.
  void RemoveObservation(MapPointId point, KeyFrameId keyframe);
  /// Recomputes the derived fields of points whose observations, position or observing poses changed since.
  void RefreshDerived();

  /// All changes since the last call as a delta to the next revision, with derived fields refreshed. Empty (IsEmpty) if
  /// nothing changed: then the revision stays. Changed points that fewer than two keyframes see are removed first:
  /// replicas refuse such points.
  MapDelta TakeDelta();
  /// The whole map as a delta from revision 0 to the current one. Changes not taken yet are in it, and harmless when
  /// they come again.
  MapDelta Snapshot() const;

  /// Finds the data of a keyframe that a delta brings in; null if it isn't there.
  using FindData = std::function<std::shared_ptr<const KeyFrameData>(KeyFrameId)>;
  /// Applies an owner's delta: all of it, or nothing when it fails, with the reason: wrong map, wrong base revision, an
  /// older epoch or (unless it is a snapshot) a newer one, missing keyframe data, or what CheckDelta (delta_check.h)
  /// finds. A valid map stays valid, whatever comes.
  Status Apply(const MapDelta& delta, const FindData& find_data);
  /// Goes on without a keyframe's orientations and descriptors (WithoutAppearance), or with them again. Its points keep
  /// the descriptors they have, also through a snapshot; points that have none get them from keyframes that have
  /// theirs.
  void ReplaceData(KeyFrameId id, std::shared_ptr<const KeyFrameData> data);

  // Covisibility: keyframes that see common points, by number of common points (paper Sec. 4: the pose graph's weight).
  /// Number of points that both see; 0 if unknown.
  int Covisibility(KeyFrameId a, KeyFrameId b) const;
  /// Neighbours with at least min_common common points, most first, then by id; `most` bounds the number (0: all).
  std::vector<std::pair<KeyFrameId, int>> CovisibleKeyFrames(KeyFrameId id, int min_common, size_t most = 0) const;
  std::vector<KeyFrameId> Children(KeyFrameId id) const;

  /// Median depth of the points that a keyframe sees, in its camera, map units; 0 if it sees none.
  double MedianDepth(KeyFrameId id) const;

 private:
  struct Changes {
    std::set<KeyFrameId> keyframes;
    std::set<MapPointId> points;
    std::map<std::pair<MapPointId, KeyFrameId>, int32_t> observations;
    std::vector<MapDelta::RemovedPoint> removed_points;
    std::vector<MapDelta::RemovedKeyFrame> removed_keyframes;
  };

  KeyFrame& MutableKeyFrame(KeyFrameId id);
  MapPoint& MutablePoint(MapPointId id);
  void ErasePoint(MapPointId id, MapPointId replaced_by);
  void LinkObservation(MapPoint* point, KeyFrameId keyframe, uint32_t feature);
  void UnlinkObservation(MapPoint* point, size_t index);
  void UnlinkAll(MapPoint* point);
  void TakeResiduals(std::vector<CameraResidual> residuals);
  std::shared_ptr<const KeyFrameData> WithKnownResidual(std::shared_ptr<const KeyFrameData> data) const;
  void RemoveUnseenPoints();
  Status CheckOrigin(const MapDelta& delta) const;
  void ApplyChecked(const MapDelta& delta, const FindData& find_data);
  void ApplyRemovals(const MapDelta& delta);
  void TakeMissingDescriptors(const Map& from);
  void ApplyObservations(const MapDelta& delta);
  void PutAllObservations(const MapDelta& delta);
  void FillCovisibility();
  static constexpr uint8_t kGeometryStale = 1, kDescriptorStale = 2;
  void MarkStale(MapPoint* point, uint8_t what);

  MapId id_;
  Epoch epoch_ = 0;
  Revision revision_ = 0;
  std::vector<CameraResidual> residuals_;
  std::map<KeyFrameId, KeyFrame> keyframes_;
  std::unordered_map<MapPointId, MapPoint> points_;
  CovisibilityGraph covisibility_;
  std::vector<MapPointId> stale_points_;  // derived fields out of date; some may be gone
  std::set<KeyFrameId> moved_keyframes_;  // what they see is stale too; some may be gone
  Changes changes_;
};

/// Hash over the map's state (poses, positions, observations, parents), independent of the order of insertion: equal
/// for equal maps.
uint64_t HashMap(const Map& map);

/// Every invariant that does not hold, in words; empty for a valid map. For tests and audits.
std::vector<std::string> ValidateMap(const Map& map);

}  // namespace portolan
