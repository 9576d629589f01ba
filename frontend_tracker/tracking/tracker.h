#pragma once

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/ids.h"
#include "base/statistics.h"
#include "dataset/image_source.h"
#include "features/orb_extractor.h"
#include "map/map_replica.h"
#include "map/protocol.h"
#include "tracking/backfill.h"
#include "tracking/camera_reach.h"
#include "tracking/coarse_to_fine.h"
#include "tracking/followed_maps.h"
#include "tracking/frame_history.h"
#include "tracking/frame_ring.h"
#include "tracking/keyframe_policy.h"
#include "tracking/link_graph.h"
#include "tracking/map_beginning.h"
#include "tracking/map_link.h"
#include "tracking/map_localizer.h"
#include "tracking/map_motion.h"
#include "tracking/place_queries.h"
#include "tracking/relocalizer.h"
#include "tracking/rotation_estimator.h"
#include "tracking/tracked_pair.h"
#include "tracking/tracker_options.h"
#include "tracking/velocity_model.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// What became of maps in a run, for its report.
struct MapEvents {
  uint64_t switches = 0;  ///< went on in another map that was there already
  uint64_t fusions = 0;   ///< of maps that the tracker had been in
  uint64_t refusals = 0;  ///< was told to go into a map and could not
  /// Each time the tracker was lost and went on in a new map: frames between the two.
  std::vector<int> frames_to_new_map;
};

/// Tracking (paper Sec. 3): estimates the camera's pose in every frame against a replica of the map, decides which
/// frames become keyframes, when a new map begins (Sec. 3.4), and goes over from map to map (Sec. 6). Pure: no DDS, no
/// threads; one thread uses it. It never waits.
///
///   Tracker tracker(options, camera, vocabulary, robot, session);
///   for each image:
///     tracker.AddDelta(delta); tracker.OnMapperState(state); ...   // what came in since the last frame
///     Tracker::Output output = tracker.Track(image);               // publish output.state, .keyframes, .requests
class Tracker {
 public:
  Tracker(const TrackerOptions& options, const CameraModel& camera, std::shared_ptr<const Vocabulary> vocabulary,
          RobotId robot, uint32_t session);

  /// What a frame gives rise to.
  struct Output {
    TrackerState state;
    std::vector<KeyFrameMessage> keyframes;  ///< to publish, in this order
    /// To the atlas_server, after the keyframes; id and sender are the caller's to fill in.
    std::vector<Request> requests;
  };

  /// What came from other processes. Deltas are queued, and taken in at the start of the next Track() or by
  /// ApplyPending(). What is of maps that the tracker does not follow is ignored.
  void AddDelta(MapDelta delta);
  void AddKeyFrameData(MapId map, std::shared_ptr<const KeyFrameData> data);
  /// @return whether it is the state of a mapper that concerns this tracker: that owns the map it is in, or the one
  /// that begins.
  bool OnMapperState(const MapperState& state);
  void OnCommand(const Command& command);
  /// @param request of this tracker, that the reply answers.
  void OnReply(const Request& request, const Reply& reply);
  /// Applies queued deltas now.
  void ApplyPending();

  /// Asks for a first map ahead of the first frame, so that the answer can be there with it. @return the requests.
  std::vector<Request> RequestFirstMap();
  Output Track(const Image& image);

  /// Whether the mapper has not answered for so long that it can't be waited for: it is down, or out of reach.
  /// Keyframes that are urgent are made all the same then, and kept for it.
  void SetMapperSilent(bool is_silent) { is_mapper_silent_ = is_silent; }

  /// Keyframes that no delta has contained yet: to be sent again to a new owner of their map. The last
  /// kMaxUnacknowledged.
  const std::map<KeyFrameId, KeyFrameMessage>& unacknowledged() const { return unacknowledged_; }
  static constexpr size_t kMaxUnacknowledged = 512;  ///< 45 MB at 2000 features each
  /// Keyframes that were more than that, the oldest each time.
  uint64_t num_given_up() const { return num_given_up_; }
  /// The last keyframe sent, if the mapper has not taken it in (or refused it) yet: what a lockstep run waits for.
  std::optional<KeyFrameId> AwaitedKeyFrame() const;
  /// Replicas that want a snapshot; the map's owner need not be waited for where IsFresh().
  std::vector<const MapReplica*> ReplicasInNeed() const { return maps_.InNeed(); }
  bool IsFresh(MapId map) const { return maps_.IsFresh(map); }

  TrackingState state() const { return state_; }
  MapId active_map() const { return active_map_; }
  const std::map<MapId, MapReplica>& replicas() const { return maps_.replicas(); }
  const LinkGraph& links() const { return links_; }
  const MapEvents& map_events() const { return events_; }
  bool localization_only() const { return options_.localization_only; }
  /// The camera as it is known: the calibration's, with what the mapper found that it left.
  const CameraModel& camera() const { return camera_; }
  const FrameHistory& history() const { return history_; }
  const StageTimes& stage_times() const { return stage_times_; }
  uint64_t num_keyframes_sent() const { return num_keyframes_sent_; }

  /// Takes up what an earlier tracker of the same run had tracked, before the first frame: its maps are followed, and
  /// the camera is looked for in them.
  void Resume(const std::vector<FrameRecord>& frames);
  /// Frames that are new in the history or hang elsewhere since the last call.
  std::vector<FrameRecord> TakeChangedFrames() { return history_.TakeChanged(); }
  /// To be called at the end of a run: localises frames that passed between the two of a map's beginning, and are known
  /// only afterwards, and hangs those on another keyframe that have lost theirs.
  void FinishHistory();

 private:
  Frame MakeFrame(const Image& image);
  void AddWords(Frame* frame) const;
  Eigen::Quaterniond EstimateRotation(const Frame& frame, const Eigen::Quaterniond& predicted);
  void Reckon(Frame* frame, bool is_tracked);
  std::optional<CameraReach> Reach(Timestamp now) const;

  // Paper Fig. 2 and Sec. 3.2.
  /// Where the camera may be, the likeliest first.
  std::vector<Rigid3d> PredictPoses(const Frame& frame);
  bool TrackInMap(Frame* frame);
  bool TrackByMotion(const Map& map, Frame* frame);
  void OnTracked(Frame* frame, Output* output);
  void OnFailed(Frame frame);
  void ConsiderKeyFrame(Frame* frame, Output* output);
  void SendTracked(Frame* frame, Output* output);
  bool HasPose() const { return state_ == TrackingState::kTracking || state_ == TrackingState::kRelocalizing; }

  // Paper Sec. 3.4 and 4.1 (tracker_new_map.cc).
  void StartNewMap();
  void QueuePastFrames();
  void Initialize(Frame frame, Output* output);
  void ContinueBeginning(Timestamp now, Output* output);
  void SendPair(Initializer::Pair pair, Output* output);
  void DropPair();  // refused, or not needed any more
  void OfferTrackedPair(const Frame& frame, Output* output);
  std::vector<Frame> PastFrames(double baseline_factor) const;
  void StopBeginning();
  void BeginTracking(uint64_t frame_now);
  void PlanToEnterNewMap();
  std::optional<Sim3d> LinkNewMap(MapId map, MapId old_map, const MapBeginning::Frames& frames);
  std::optional<Sim3d> MeasureNewLink(MapId map, MapId old_map, const Frame& first, const Frame& second);
  void RefineLink();
  std::optional<Overlap> OverlapWith(const Frame& frame, const Map& map, const Map& old_map) const;
  void GoOnFrom(Frame frame);
  void BackfillOne(Output* output);
  std::optional<Frame> LocalizeBetween();
  void FinishBackfill();
  void AskForPlace(Frame* frame, Output* output);

  // Paper Sec. 6, the tracker's part (tracker_maps.cc).
  /// A map to go over into, and for how long that has been tried.
  struct PlannedMove {
    MapId target;
    std::optional<Sim3d> target_from_active;
    bool by_command = false;
    bool is_new_map = false;
    int frames_tried = 0;
    std::optional<Timestamp> since;
  };
  /// With a frame that is tracked: it may go over into another map, in which it is tracked then. @return whether it
  /// did.
  bool ConsiderMapChange(Frame* frame);
  bool TryPlannedMove(Frame* frame, bool is_tracked);
  void GiveUpMove(const std::string& reason);
  bool GoOnInLinkedMap(Frame* frame, bool is_tracked);
  bool RelocalizeAnywhere(Frame* frame);
  void GoOver(MapId target, Frame moved, const Frame* before, const std::optional<Sim3d>& target_from_active,
              Frame* frame);
  void LookBack(const Frame& frame);
  std::optional<Overlap> LookBackWith(const Frame& frame, const Map& left, const Sim3d& left_from_map);
  std::optional<Overlap> LookBackWithEarlier(const Map& left, const Sim3d& left_from_map);
  std::vector<MapId> OtherMaps() const;
  bool IsFull(const Map& map) const;
  void PlanMove(const Command& command);
  void CompleteFusions();
  bool IsFusionHere(const Command& fusion) const;
  void CompleteFusion(const Command& fusion);
  void GoOnInFused(const Command& fusion);
  void ForgetMap(MapId map);
  void AskAtlas(const std::string& kind, MapId map, MapId other, const std::optional<Sim3d>& map_from_other,
                const std::string& argument);

  KeyFrameId Send(KeyFrameKind kind, Frame* frame, KeyFrameMessage message, Output* output);
  KeyFrameMessage MakeMessage(KeyFrameKind kind, Frame* frame, KeyFrameMessage message);
  void TakeResidual();
  void OnApplied(const Map& map, const MapDelta& delta);
  void Acknowledge(KeyFrameId id);
  void TakeBack(const MapDelta& snapshot);
  /// Pose and velocity stay where they are in the scene when the map around the reference keyframe moved.
  void MoveWithMap(const Sim3d& new_from_old);
  bool Concerns(const MapperState& state) const;
  void NoteOwner(MapId map, Epoch epoch, ProcessId process);
  bool IsMapperIdle() const;
  const Map& ActiveMap() const { return maps_.map(active_map_); }

  TrackerOptions options_;
  const RobotId robot_;
  CameraModel camera_;
  std::shared_ptr<const Vocabulary> vocabulary_;
  OrbExtractor extractor_;
  RotationEstimator rotation_estimator_;
  VelocityModel velocity_model_;
  MapTracker map_tracker_;
  Relocalizer relocalizer_;
  KeyFramePolicy keyframe_policy_;
  MapBeginning beginning_;
  FrameRing ring_;
  MapLocalizer localizer_;
  PlaceQueries queries_;
  Backfill backfill_;
  MapId backfill_map_;
  int backfill_waits_ = 0;  // frames since, for an idle mapper
  FrameHistory history_;
  StageTimes stage_times_;

  IdMinter<KeyFrameId> keyframe_ids_;
  IdMinter<MapId> map_ids_;
  FollowedMaps maps_;
  LinkGraph links_;
  MapEvents events_;
  std::vector<Request> requests_;  // since the last frame
  std::optional<PlannedMove> move_;
  struct Handover {
    MapId map, left;
    KeyFrameId left_reference;   // of the latest frame that was localised in the map left
    std::vector<Frame> earlier;  // tracked in the map left, the oldest first; not localised in the other yet
    std::vector<Overlap> overlaps;
    int frames = 0;
    size_t measured_from = 0;  // overlaps
  };
  // The map just gone into and the one left, until their link is sure.
  std::optional<Handover> handover_;
  std::vector<Command> fusions_;  // whose outcome is not in the replica yet
  struct YoungLink {
    MapId map, old_map;
    Frame first, second;  // of the new map, as they were tracked in the old one
  };
  std::optional<YoungLink> young_link_;  // to be measured again when the new map has grown
  int leaving_frames_ = 0;               // tracked one after another where a full map ends
  int refused_pairs_ = 0;                // of the map that begins
  MapId spare_map_;                      // asked for, and not begun
  size_t next_other_map_ = 0;            // whose turn it is when lost
  std::map<KeyFrameId, KeyFrameMessage> unacknowledged_;
  std::deque<KeyFrameMessage> acknowledged_;  // the last ones: a new owner may not have got them
  std::map<MapId, Epoch> applied_epochs_;     // of the last delta of each map

  TrackingState state_ = TrackingState::kInitializing;
  MapId active_map_;                                 // none until the first map is there
  std::optional<Frame> last_frame_;                  // tracked or not; its pose is the prediction if not
  std::optional<Eigen::Quaterniond> turn_by_image_;  // from last_frame_ to the one in work, as ESM saw it
  // ESM has followed the pictures since the last tracked frame.
  bool is_view_continuous_ = false;
  std::vector<ReferenceLandmark> reference_;  // of the last tracked frame
  KeyFrameId reference_keyframe_;
  int lost_frames_ = 0;
  std::optional<uint64_t> lost_since_;  // frame at which the tracker gave its map up

  MapperState mapper_state_;
  struct Owner {
    Epoch epoch = 0;
    ProcessId process;
  };
  std::map<MapId, Owner> owners_;
  std::optional<KeyFrameId> awaited_keyframe_;
  bool is_mapper_silent_ = false;
  uint64_t num_keyframes_sent_ = 0, num_given_up_ = 0;
};

}  // namespace portolan
