#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/time.h"
#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "geometry/sim3.h"
#include "map/keyframe.h"
#include "map/map_delta.h"
#include "map/map_replica.h"

// What the processes tell each other, as domain types without DDS. messages/ converts them to and from the wire and
// validates what comes in; docs/topics.md lists topics, writers and readers. MapDeltaChunk and SnapshotRequest stand
// with the map.

namespace portolan {

enum class KeyFrameKind : uint8_t {
  kTracked = 0,        ///< tracked in `map`: pose and landmarks are given
  kInitialFirst = 1,   ///< first of a pair for map initialisation (paper Sec. 4.1)
  kInitialSecond = 2,  ///< second of the pair: `reference` is the first, `initial_matches` its matches
  kCopy = 3,           ///< data alone, sent again by a map's owner to answer a SnapshotRequest
  /// Data alone, of a tracker that knows no map here: its "locate" request names it (paper Sec. 6: any unactivated
  /// map).
  kQuery = 4,
};

/// A keyframe from the tracker: its data, published once, and how the tracker saw it. Sent again to a new owner until a
/// delta contains it.
struct KeyFrameMessage {
  KeyFrameData data;  ///< derived fields empty; the receiver completes them with MakeKeyFrameData
  KeyFrameKind kind = KeyFrameKind::kTracked;
  uint64_t vocabulary_hash = 0;
  MapId map;
  KeyFrameId reference;  ///< kTracked: the keyframe it shares most landmarks with; kInitialSecond: the first
  /// kTracked: pose; kInitialSecond: second_from_first, rotation alone as ESM estimated it (translation 0), or whole,
  /// in units of the map in which both are tracked.
  Rigid3d camera_from_map;
  /// kTracked: (feature, landmark), inliers of the final pose.
  std::vector<std::pair<uint32_t, MapPointId>> landmarks;
  /// kInitialSecond: (feature of reference, own feature).
  std::vector<std::pair<uint32_t, uint32_t>> initial_matches;
};

enum class TrackingState : uint8_t {
  kInitializing = 0,  ///< no map yet: looking for two frames to make one from
  kTracking = 1,
  kRelocalizing = 2,  ///< quality is poor: fewer than five frames lost
  kLost = 3,          ///< gave the map up; a new one is being made
};

/// The tracker's word on one frame.
struct TrackerState {
  ProcessId process;
  uint64_t frame = 0;
  Timestamp stamp;
  TrackingState state = TrackingState::kInitializing;
  MapId map;
  Rigid3d camera_from_map;      ///< meaningful in kTracking
  float quality = 0;            ///< s = n / m (paper Sec. 3.3)
  uint32_t num_inliers = 0;     ///< n
  uint32_t num_candidates = 0;  ///< m
  float frame_ms = 0;           ///< the tracker's whole work for the frame, image decoding left out
  /// A keyframe is due and only the busy mapper is in its way: stop the optimisation (paper Sec. 3.3).
  bool interrupt_mapper = false;
};

/// What the mapper is doing: sent whenever it changes.
struct MapperState {
  ProcessId process;
  MapId map;
  Epoch epoch = 0;
  Revision revision = 0;
  /// Queue empty and no optimisation running: the third keyframe condition (paper Sec. 3.3).
  bool idle = false;
  uint32_t queue_depth = 0;  ///< keyframes waiting
  KeyFrameId last_keyframe;  ///< the last keyframe fully taken in (or refused), for lockstep and acknowledgement
  /// The last keyframe refused (second of an initial pair, or one that does not fit), none if none.
  KeyFrameId refused_keyframe;
  std::string refusal;             ///< why
  bool is_refining = false;        ///< long work beside the mapping is under way: lockstep waits for it
  ProcessId correction_process;    ///< whose correction was answered last, none if none;
  uint64_t correction_number = 0;  ///< its number there:
  std::string correction_refusal;  ///< why it was not applied; empty: it is in the map at `revision`
};

/// How far a process that looks at each keyframe has come (loop_closer: loops, atlas_server: overlaps): sent whenever
/// it changes.
struct FollowerState {
  ProcessId process;
  MapId map;
  Epoch epoch = 0;
  KeyFrameId last_keyframe;  ///< the last keyframe looked at (or passed over): lockstep waits for it
  bool is_busy = false;      ///< a correction is being made or waits to be applied; lockstep waits for it
  Revision revision = 0;     ///< of the replica
};

/// A proposal to change a map, made from a snapshot of it (loop closure, FBA, global BA, fusion). The owner applies it;
/// keyframes younger than the revision follow the keyframe they hang on (paper Sec. 6, step 3).
struct MapCorrection {
  struct KeyFrameCorrection {
    KeyFrameId id;
    Sim3d camera_from_map;  ///< corrected; the owner turns it rigid (paper Eq. 13)
  };
  struct PointCorrection {
    MapPointId id;
    Eigen::Vector3f position_in_map = Eigen::Vector3f::Zero();
  };
  ProcessId process;
  uint64_t number = 0;  ///< of this process, rising
  MapId map;
  Epoch epoch = 0;
  Revision made_from_revision = 0;
  std::string kind;  ///< "loop", "fba", "global_ba", "fusion"
  /// Kind "fusion": the map to be taken in whole, keyframes that came to it since included; else none.
  MapId other;
  Sim3d map_from_other;  ///< kind "fusion": where; the keyframes and points named below are placed more exactly
  std::vector<KeyFrameCorrection> keyframes;
  std::vector<PointCorrection> points;
  std::vector<std::pair<MapPointId, MapPointId>> merges;         ///< (from, into), in order
  std::vector<std::pair<MapPointId, Observation>> observations;  ///< to add, after the merges
  std::vector<std::pair<KeyFrameId, KeyFrameId>> loop_edges;
};

enum class CommandKind : uint8_t {
  kGrantOwnership = 0,  ///< `owner` writes `map` in `epoch` from now on; the atlas_server itself: the map is dormant
  /// Trackers in `other` (none: the tracker of `robot`, which has no map) are to go on in `map`; each tries, and
  /// answers with a request, enter_map or refuse_map.
  kActivateMap = 1,
  kFuseMaps = 2,   ///< has happened: `map` has taken in all of `other`, which is no more
  kLinkMaps = 3,   ///< has been found: where two maps lie to each other
  kNewMap = 4,     ///< the tracker of `robot` begins a new map
  kAdjustMap = 5,  ///< the loop_closer that follows `map` adjusts all of it (global BA)
  kPause = 6,      ///< the tracker of `robot` takes no more frames
  kResume = 7,
  kLocalizeOnly = 8,  ///< the tracker of `robot` changes no map from now on: neither keyframes nor new maps
  kMapAgain = 9,      ///< ends kLocalizeOnly
  kForgetMap = 10,    ///< `map` was deleted
  kShutDown = 11,     ///< processes of `robot` drain, save and end
  /// `owner` is to leave its place to a standby: it ends what it has begun, takes on no more, and says what it holds;
  /// so does the standby.
  kDrain = 12,
  /// `owner` has the place of `robot`'s mapper from now on; one that drained leaves, or, if it is itself, goes on.
  kAppointMapper = 13,
  kAppointLoopCloser = 14,
  kAppointAtlasServer = 15,  ///< `owner` decides from now on; another atlas_server leaves
};

/// ProcessStatus::state of a process that follows, and waits to take the place of another of its role and robot.
constexpr const char* kStandbyState = "standby";

/// From the atlas_server alone.
struct Command {
  uint64_t number = 0;  ///< of this atlas_server session, rising
  ProcessId sender;
  CommandKind kind = CommandKind::kGrantOwnership;
  MapId map;
  MapId other;
  Epoch epoch = 0;
  ProcessId owner;
  RobotId robot = 0;     ///< whom it concerns, where the kind says so
  Sim3d map_from_other;  ///< kActivateMap, kFuseMaps, kLinkMaps
};

/// To the atlas_server, from the tracker, tools and operators. docs/topics.md lists the kinds.
struct Request {
  RequestId id;
  ProcessId sender;
  std::string kind;  ///< "new_map", "enter_map", "link_maps", "locate", "register_mapper", "list_maps", "save", ...
  MapId map;
  MapId other;           ///< new_map, enter_map: the map the tracker was in; link_maps: the other of the two
  Sim3d map_from_other;  ///< enter_map, link_maps
  std::string argument;
};

struct Reply {
  RequestId id;
  ProcessId sender;
  bool ok = false;
  std::string reason;
  std::string text;  ///< of an answer that is a text
};

/// A process about itself, once a second and at changes; its liveliness is the sign that its worker thread is alive.
struct ProcessStatus {
  ProcessId process;
  std::string role;  ///< frontend_tracker, backend_mapper, loop_closer, atlas_server
  std::string host;
  uint32_t pid = 0;
  std::string vendor;  ///< fastdds, cyclonedds
  std::string build;
  std::string priority;  ///< as in force: "nice -5", "SCHED_RR 20"
  std::string state;     ///< in words
  MapId map;
  Epoch epoch = 0;
  Revision revision = 0;
  std::vector<std::pair<std::string, double>> figures;  ///< counters, queue depths, drops, milliseconds, by name
};

}  // namespace portolan
