#pragma once

#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "atlas/atlas.h"
#include "atlas/overlap_detector.h"
#include "map/protocol.h"
#include "map_optimization/loop_correction.h"

namespace portolan {

struct JoinOptions {
  /// Of the current map: with more the tracker switches to the overlapped map, with fewer the two are fused (paper Sec.
  /// 6).
  int switch_keyframes = 50;
  /// Of the current map, after a proposal that came to nothing, and before the way back after a switch.
  int retry_keyframes = 20;
  /// Of one fusion: a map that is being corrected refuses what was made from its last state.
  int max_proposals = 3;
  /// For the tracker's answer: it tries for 30 frames, and may have to fetch the map first.
  double switch_patience_s = 10;
  double grant_patience_s = 20;   ///< until one mapper holds both maps of a fusion
  double answer_patience_s = 10;  ///< for the mapper's answer to a proposed fusion
};

/// A fusion whose maps one mapper owns: to be proposed from copies of both.
struct FusionTask {
  MapId map, other;  ///< other goes into map
  DetectedOverlap overlap;
};

/// What became of an overlap.
struct JoinRecord {
  enum class Kind { kSwitch, kFusion };
  Kind kind = Kind::kSwitch;
  RobotId robot = 0;
  MapId map, other;             ///< switch: from other to map; fusion: other goes into map
  KeyFrameId current, matched;  ///< that saw it; none for one that was ordered
  size_t keyframes = 0;         ///< of the current map at the time
  Sim3d map_from_other;
  double decided_s = 0, done_s = 0;  ///< of the caller's clock
  bool is_done = false;
  std::string problem;  ///< why it came to nothing
};

/// Brings overlapping maps together (paper Sec. 6, step 2): has the tracker switch to a dormant map, or two maps fused
/// by one mapper. One proposal a robot at a time; each ends within bounded time, well or with a reason. Pure: it speaks
/// through `atlas`, which must outlive it.
///
///   if (joiner.WantsOverlap(robot, map, other, now_s)) ...detect...; joiner.OnOverlap(robot, overlap, now_s);
///   joiner.OnMove(move, now_s); joiner.OnMapperState(state, now_s); joiner.OnTick(now_s);
///   if (auto task = joiner.NextFusion(epoch_of, agree, now_s)) joiner.OnProposed(ProposeFusion(...), now_s);   // on
///   another thread if (auto correction = joiner.TakeCorrection()) publish it;
class MapJoiner {
 public:
  MapJoiner(ProcessId self, const JoinOptions& options, Atlas* atlas) : self_(self), options_(options), atlas_(atlas) {}

  /// A keyframe of the robot's map was looked at: time, for retries.
  void OnKeyFrame(MapId map) { ++keyframes_[map]; }
  /// Whether anything would follow from an overlap between the map a robot is in and another: otherwise it is not
  /// looked for.
  bool WantsOverlap(RobotId robot, MapId map, MapId other, double now_s) const;
  void OnOverlap(RobotId robot, const DetectedOverlap& overlap, double now_s);
  /// The robot's tracker is to go to `map` by order of a user, who hears of it when it has ended (TakeEndedOrders).
  /// @return why not.
  Status Order(const Request& order, RobotId robot, MapId map, double now_s);
  /// Two maps are to be fused by order of a user, the same way. @return why not.
  Status OrderFusion(const Request& order, const DetectedOverlap& overlap, double now_s);
  /// Orders that have come to their end since the last call, well or not.
  struct EndedOrder {
    Request order;
    JoinRecord record;
  };
  std::vector<EndedOrder> TakeEndedOrders() { return std::exchange(ended_orders_, {}); }

  void OnMove(const Atlas::Move& move, double now_s);
  void OnMapperState(const MapperState& state, double now_s);
  void OnTick(double now_s);

  /// A fusion that is to be proposed now; once. None while another is being made. @param epoch_of a map's replica; 0 if
  /// it is not whole. @param agree whether two maps' keyframes had the same residuals taken out (CheckResiduals); until
  /// they do the fusion waits.
  std::optional<FusionTask> NextFusion(const std::function<Epoch(MapId)>& epoch_of,
                                       const std::function<bool(MapId, MapId)>& agree, double now_s);
  void OnProposed(Result<MapCorrection> proposal, double now_s);
  std::optional<MapCorrection> TakeCorrection();

  /// A fusion concerns the map, is decided and not done: lockstep waits for it.
  bool IsFusing(MapId map) const;
  /// (map, other) of fusions that the owner has applied since the last call, with the revision of map that has it.
  struct Done {
    MapId map, other;
    Revision revision = 0;
  };
  std::vector<Done> TakeDone() { return std::exchange(done_, {}); }

  const std::deque<JoinRecord>& records() const { return records_; }
  struct Counters {
    uint64_t overlaps = 0, switches = 0, fusions = 0, refused = 0;
  };
  const Counters& counters() const { return counters_; }
  size_t num_open() const { return proposals_.size(); }

 private:
  enum class Stage { kSwitching, kGathering, kProposing, kProposed };
  struct Proposal {
    RobotId robot = 0;
    Stage stage = Stage::kSwitching;
    double since_s = 0;  ///< of the stage
    MapId map, other;
    DetectedOverlap detected;  ///< of a fusion
    ProcessId owner;           ///< that is to own both maps of a fusion
    uint64_t number = 0;       ///< of the correction
    int refusals = 0;
    Sim3d map_from_other;
    JoinRecord record;
    std::optional<Request> order;  ///< by which it was made; none: by an overlap
  };
  using Proposals = std::vector<Proposal>;

  bool IsBusy(MapId map) const;
  bool IsBlocked(MapId map, MapId other) const;
  void Block(MapId map, MapId other);
  void Switch(RobotId robot, const DetectedOverlap& overlap, double now_s);
  void BeginFusion(RobotId robot, MapId map, MapId other, const DetectedOverlap& overlap, double now_s);
  void Gather(Proposal* proposal, double now_s);
  void Finish(Proposals::iterator proposal, const std::string& problem, double now_s);
  double PatienceOf(Stage stage) const;

  ProcessId self_;
  JoinOptions options_;
  Atlas* atlas_;
  Proposals proposals_;
  std::map<MapId, uint64_t> keyframes_;                        // looked at
  std::map<std::pair<MapId, MapId>, uint64_t> blocked_until_;  // (current, other): count of keyframes_
  std::optional<MapCorrection> outbox_;
  uint64_t next_number_ = 1;
  std::vector<Done> done_;
  std::vector<EndedOrder> ended_orders_;
  std::deque<JoinRecord> records_;
  Counters counters_;
};

/// The overlap as a fusion needs it: `current` a keyframe of the map that is no more, whichever side found it.
/// @param other_map the map that goes, @param map the one that stays.
LoopClosure ToLoopClosure(const DetectedOverlap& overlap, const Map& map, const Map& other_map);

}  // namespace portolan
