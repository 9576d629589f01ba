#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/ids.h"
#include "base/statistics.h"
#include "dataset/image_source.h"
#include "features/orb_extractor.h"
#include "map/map_replica.h"
#include "map/protocol.h"
#include "tracking/backfill.h"
#include "tracking/coarse_to_fine.h"
#include "tracking/frame_history.h"
#include "tracking/keyframe_policy.h"
#include "tracking/map_beginning.h"
#include "tracking/map_motion.h"
#include "tracking/relocalizer.h"
#include "tracking/rotation_estimator.h"
#include "tracking/tracker_options.h"
#include "tracking/velocity_model.h"
#include "vocabulary/keyframe_index.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// Tracking (paper Sec. 3): estimates the camera's pose in every frame against a replica of the map, and decides which frames become keyframes and when a new
/// map begins. Pure: no DDS, no threads; one thread uses it. It never waits.
///
///   Tracker tracker(options, camera, vocabulary, robot, session);
///   for each image:
///     tracker.AddDelta(delta); tracker.OnMapperState(state); ...   // what came in since the last frame
///     Tracker::Output output = tracker.Track(image);               // publish output.state, .keyframes, .requests
class Tracker {
 public:
  Tracker(const TrackerOptions& options, const CameraModel& camera, std::shared_ptr<const Vocabulary> vocabulary, RobotId robot,
          uint32_t session);

  /// What a frame gives rise to.
  struct Output {
    TrackerState state;
    std::vector<KeyFrameMessage> keyframes;  ///< to publish, in this order
    std::vector<MapId> new_maps;             ///< to ask the atlas_server an owner for
  };

  /// Queue what came from other processes; taken in at the start of the next Track() or by ApplyPending().
  void AddDelta(MapDelta delta);
  void AddKeyFrameData(std::shared_ptr<const KeyFrameData> data);
  void OnMapperState(const MapperState& state);
  /// Applies queued deltas now.
  void ApplyPending();

  Output Track(const Image& image);

  /// Keyframes that no delta has contained yet: to be sent again to a new owner of their map.
  std::vector<KeyFrameMessage> UnacknowledgedKeyFrames() const;
  size_t num_unacknowledged() const { return unacknowledged_.size(); }
  /// The last keyframe sent, if the mapper has not taken it in (or refused it) yet: what a lockstep run waits for.
  std::optional<KeyFrameId> AwaitedKeyFrame() const;
  /// Replicas that want a snapshot.
  std::vector<const MapReplica*> ReplicasInNeed() const;

  TrackingState state() const { return state_; }
  MapId active_map() const { return active_map_; }
  const std::map<MapId, MapReplica>& replicas() const { return replicas_; }
  /// The camera as it is known: the calibration's, with what the mapper found that it left.
  const CameraModel& camera() const { return camera_; }
  const FrameHistory& history() const { return history_; }
  const StageTimes& stage_times() const { return stage_times_; }
  uint64_t num_keyframes_sent() const { return num_keyframes_sent_; }

  /// Localises frames that passed between the two of a map's beginning, and are known only afterwards. To be called at the end of a run.
  void FinishBackfill();

 private:
  Frame MakeFrame(const Image& image);
  void AddWords(Frame* frame) const;
  Eigen::Quaterniond EstimateRotation(const Frame& frame, const Eigen::Quaterniond& predicted);

  // Paper Fig. 2 and Sec. 3.2.
  /// Where the camera may be, the likeliest first.
  std::vector<Rigid3d> PredictPoses(const Frame& frame);
  /// The coarse stage from the first prediction by which it finds enough of the reference's landmarks, else from the best. @return n.
  int TrackCoarse(const Map& map, const std::vector<Rigid3d>& predictions, double radius_px, Frame* frame) const;
  bool TrackInMap(Frame* frame);
  bool TrackByMotion(const Map& map, Frame* frame);
  void OnTracked(Frame* frame, Output* output);
  void OnFailed(const Frame& frame, Output* output);
  void ConsiderKeyFrame(Frame* frame, Output* output);

  // Paper Sec. 3.4 and 4.1.
  void StartNewMap(Output* output);
  void Initialize(Frame frame, Output* output);
  bool TryOldMap(Frame* frame);
  void SendPair(Initializer::Pair pair, Output* output);
  void DropPair();  // refused, or not needed any more
  void BeginTracking();
  void GoOnFrom(Frame frame);
  void BackfillOne();

  KeyFrameId Send(KeyFrameKind kind, Frame* frame, KeyFrameMessage message, Output* output);
  void OnApplied(const Map& map, const MapDelta& delta);
  /// Pose and velocity stay where they are in the scene when the map around the reference keyframe moved.
  void MoveWithMap(const MapMotion& motion);
  bool IsMapperIdle() const;
  MapReplica& ActiveReplica() { return replicas_.at(active_map_); }

  TrackerOptions options_;
  CameraModel camera_;
  std::shared_ptr<const Vocabulary> vocabulary_;
  OrbExtractor extractor_;
  RotationEstimator rotation_estimator_;
  VelocityModel velocity_model_;
  MapTracker map_tracker_;
  Relocalizer relocalizer_;
  KeyFramePolicy keyframe_policy_;
  MapBeginning beginning_;
  Backfill backfill_;
  FrameHistory history_;
  StageTimes stage_times_;

  IdMinter<KeyFrameId> keyframe_ids_;
  IdMinter<MapId> map_ids_;
  std::map<MapId, MapReplica> replicas_;
  KeyFrameIndex index_;                                     // of the active map's keyframes
  std::map<KeyFrameId, KeyFrameMessage> unacknowledged_;

  TrackingState state_ = TrackingState::kInitializing;
  MapId active_map_;                                        // none until the first map is there
  std::optional<Frame> last_frame_;                         // tracked or not; its pose is the prediction if not
  std::vector<ReferenceLandmark> reference_;                // of the last tracked frame
  KeyFrameId reference_keyframe_;
  int lost_frames_ = 0;

  MapperState mapper_state_;
  std::optional<KeyFrameId> awaited_keyframe_;
  uint64_t num_keyframes_sent_ = 0;
};

}  // namespace portolan
