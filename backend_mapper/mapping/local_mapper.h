#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "base/statistics.h"
#include "base/time.h"
#include "geometry/plane_witness.h"
#include "map/map.h"
#include "map/protocol.h"
#include "mapping/lens_refinement.h"
#include "mapping/local_bundle_adjustment.h"
#include "mapping/mapper_options.h"
#include "mapping/point_fusion.h"
#include "mapping/pruning.h"
#include "mapping/successors.h"

namespace portolan {

/// Single mapping (paper Sec. 4): the one writer of one map. Pure: no DDS, no threads of its own; the process feeds it
/// keyframes and sends the deltas that it hands out.
///
///   IdMinter<MapPointId> point_ids(robot, session);                        // one for all maps of a process
///   LocalMapper mapper(options, map_id, epoch, &point_ids, publish);
///   Status initialized = mapper.Initialize(first, second, message);        // Sec. 4.1
///   mapper.InsertKeyFrame(data, message);                                  // Sec. 4.2, for each further keyframe:
///   mapper.DropFailedPoints(); mapper.ExtendMap(more_work_waits);
///   mapper.FuseDuplicates(); mapper.OptimizeLocally(stop); mapper.Prune();
///   // or all of it, each step's delta published as soon as it is made:
///   mapper.Process(data, message, more_work_waits, stop);
///
/// Deterministic: the same keyframes, answers of more_work_waits and no stop give the same deltas. Not thread-safe, but
/// for `stop`.
class LocalMapper {
 public:
  using Publish = std::function<void(MapDelta)>;
  using MoreWorkWaits = std::function<bool()>;
  using KeyFramePtr = std::shared_ptr<const KeyFrameData>;

  /// @param point_ids names new landmarks, and outlives this: one map may be taken into another, or come back.
  LocalMapper(const MapperOptions& options, MapId map, Epoch epoch, IdMinter<MapPointId>* point_ids, Publish publish);
  /// Takes over a map that another owner made (from a replica). Its first word must be PublishSnapshot(): replicas take
  /// nothing else in a new epoch.
  LocalMapper(const MapperOptions& options, Map map, Epoch epoch, IdMinter<MapPointId>* point_ids, Publish publish);

  const Map& map() const { return map_; }
  /// Whether the keyframe is in the map, or was until it was removed as redundant.
  bool HasHad(KeyFrameId id) const { return map_.FindKeyFrame(id) != nullptr || removed_keyframes_.Follow(id) != id; }

  /// Map initialisation from two keyframes (paper Sec. 4.1, second step to last). Publishes the new map, or fails with
  /// the reason and leaves the map empty. The median depth of the first keyframe becomes 1.
  Status Initialize(KeyFramePtr first, KeyFramePtr second, const KeyFrameMessage& message);

  /// One tracked keyframe through all steps, cheapest news first: insertion is published at once, then new points, then
  /// fusion and local BA (left out while `more_work_waits` says so), then pruning. `stop` interrupts the BA. Fails,
  /// changing nothing, when the keyframe does not fit the map: its reference is unknown, it is there already, or fewer
  /// than options.min_landmarks agree with its pose: of those that it names and that still exist, or, where most are
  /// gone, of those around its reference that are where its pose puts them.
  Status Process(KeyFramePtr data, const KeyFrameMessage& message, const MoreWorkWaits& more_work_waits,
                 const std::atomic<bool>* stop);

  // The steps of Process, to be called in this order; each leaves its change for PublishChanges.
  /// Adds the keyframe where its landmarks, as they are now, put it (motion-only BA from the tracker's pose), with
  /// those that agree.
  Status InsertKeyFrame(KeyFramePtr data, const KeyFrameMessage& message);
  /// Removes new points that failed their probation. @return how many.
  int DropFailedPoints();
  /// New points from the newest keyframe and its neighbours. @return how many.
  int ExtendMap(const MoreWorkWaits& more_work_waits);
  FusionResult FuseDuplicates();
  LocalBundleResult OptimizeLocally(const std::atomic<bool>* stop);
  /// Removes unreliable points and redundant keyframes. @return the keyframes.
  std::vector<KeyFrameId> Prune();
  /// Hands the changes since the last call to `publish`, if there are any.
  void PublishChanges();
  /// Hands the whole map to `publish`.
  void PublishSnapshot();

  /// What to look for the calibration's residual in (FindRadialResidual), whenever the map has grown by enough (see
  /// LensRefinementOptions): a larger map tells more exactly. It is long work, so that the caller does it beside this
  /// one's, and brings the finding.
  std::optional<LensProblem> NextLensProblem();
  void TakeLensFinding(const LensFinding& finding);
  /// Takes a residual out of all keyframes of its camera, with what AdaptToResidual made of a copy of the map, and
  /// publishes it. Fails, changing nothing, when another correction was applied since the copy was made.
  Status TakeResidual(const CameraResidual& known, const MapCorrection& adaptation);

  /// Applies a proposal of another process and publishes it; fails, changing nothing, when it does not fit (see
  /// ApplyMapCorrection), or was made before the last one was applied, or before the map's features changed
  /// (TakeResidual).
  Status ApplyCorrection(const MapCorrection& correction);
  /// Takes another map in whole, by a proposal to fuse them, and publishes it; what names landmarks and keyframes that
  /// had gone from the other map finds what stands for them here. Fails, changing nothing, when the proposal does not
  /// fit (see ApplyFusion), or was made before the map was last corrected, or its features changed (TakeResidual): then
  /// it may lie elsewhere now.
  Status TakeIn(const LocalMapper& other, const MapCorrection& fusion);

  /// Milliseconds of the steps: insert, extend, fuse, local_ba, prune.
  const StageTimes& stage_times() const { return stage_times_; }

 private:
  struct TrackedLandmarks;
  void FindByPose(const KeyFrameData& data, KeyFrameId reference, const Rigid3d& camera_from_map,
                  TrackedLandmarks* tracked) const;
  TrackedLandmarks FindLandmarks(const KeyFrameData& data, const KeyFrameMessage& message) const;
  void NoteMerges(const std::vector<std::pair<MapPointId, MapPointId>>& merges);

  MapperOptions options_;
  Map map_;
  IdMinter<MapPointId>* point_ids_;
  Publish publish_;
  StageTimes stage_times_;
  PlaneWitness plane_witness_;  // while the map is to begin: of the first keyframe offered last
  Timestamp witnessed_first_;   // that keyframe's
  KeyFrameId newest_;           // the keyframe that the steps work on
  PointProbation probation_;
  Revision corrected_revision_ = 0;  // the map's revision after the last correction or fusion
  Revision moved_revision_ = 0;      // after the last correction
  Revision last_residual_ = 0;       // after TakeResidual
  // Number of keyframes; a map taken over may hold frames from before and after a refinement.
  int next_lens_refinement_;
  Successors<MapPointId> merged_points_;  // the tracker may still name what was merged or removed here
  Successors<KeyFrameId> removed_keyframes_;
};

}  // namespace portolan
