#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "atlas/atlas.h"
#include "map/held_map.h"
#include "map/protocol.h"

namespace portolan {

/// Has a process leave its place to one that stands by, so that nothing is lost: the order "swap". And fills the place
/// of a loop_closer that has died (that of a mapper: Atlas; that of an atlas_server: whoever stands by behind it).
/// Pure: it speaks through `atlas`, which must outlive it.
///
/// A mapper is told to drain; it and the standby tell what they hold of each of its maps ("holds_map"). When it has
/// drained and the standby holds the same, by revision and hash, all its maps pass on in their next epochs, and it
/// leaves. The order is answered when the new mapper has told what it holds as their owner. A loop_closer owns nothing:
/// it ends the loop that it is closing, and the standby must have come as far as it had. An atlas_server, this one,
/// hands over when the standby holds all its maps, or, where both have one file, those that may not be in it yet.
/// Whatever does not come about within its time leaves all as it was, and the order is answered with the reason.
class Succession {
 public:
  /// What this process holds of a map itself; none: nothing.
  using Measure = std::function<std::optional<HeldMap>(MapId)>;

  Succession(ProcessId self, Atlas* atlas, Measure measure)
      : self_(self), atlas_(atlas), measure_(std::move(measure)) {}

  void OnOrder(const Request& order, double now_s);
  /// "holds_map" and "drained": what a process says in a swap. Not answered.
  void OnReport(const Request& report, double now_s);
  void OnTick(double now_s);

  /// An order to leave, once the standby may have the place: it is to be told (Leave) when all is stored, or it is not
  /// to be (Stay).
  bool MayLeave() const { return leaving_.has_value(); }
  void Leave(double now_s);
  void Stay(const std::string& reason);

  uint64_t num_swaps() const { return swaps_done_; }
  /// Of loop_closers that died.
  uint64_t num_promotions() const { return promotions_; }

  /// For an optimisation that is under way, the keyframes before it and a few more deltas: a standby is behind by so
  /// much always.
  static constexpr double kMaxLag = 20;
  /// Until the one has drained, and the other has come as far.
  static constexpr double kDrainS = 10;
  /// Until the new one has said what it holds.
  static constexpr double kTakeOverS = 10;
  /// An appointment is repeated until it shows in the process's status.
  static constexpr double kAppointAgainS = 1;

 private:
  enum class Stage { kDraining, kTakingOver };
  using HeldMaps = std::map<MapId, HeldMap>;
  struct Swap {
    Request order;
    std::string role;
    RobotId robot = 0;
    ProcessId from, to;
    Stage stage = Stage::kDraining;
    double begun_s = 0, since_s = 0;  ///< of the swap, of the stage
    bool is_drained = false;
    HeldMaps before, waiting, after;  ///< what the old one held at last, the standby while it waited, the new one
  };

  Result<Swap> Begin(const Request& order, double now_s) const;
  Status CheckStandby(const Swap& swap) const;
  /// @return whether the swap is over.
  bool Continue(Swap* swap, double now_s);
  bool ContinueDraining(Swap* swap, double now_s);
  Result<bool> HoldsEnough(Swap* swap) const;
  Result<bool> HoldsMapsOfMapper(const Swap& swap) const;
  Result<bool> HoldsMapsOfAtlas(Swap* swap) const;
  void PassOn(Swap* swap, double now_s);
  void CallOff(const Swap& swap, const std::string& reason);
  void Finish(const Swap& swap, double now_s);
  void Refuse(const Request& order, const std::string& reason);
  void FillPlaces(double now_s);

  ProcessId self_;
  Atlas* atlas_;
  Measure measure_;
  std::vector<Swap> swaps_;
  std::optional<Swap> leaving_;
  std::map<RobotId, double> appointed_s_;  // loop_closers in place of dead ones
  uint64_t swaps_done_ = 0, promotions_ = 0;
};

/// The answer to a swap, as a text for programs: {"role", "robot", "from", "to", "seconds", "maps": [{"map", "before":
/// {"keyframes", "points", "revision", "epoch", "hash"}, "after": {...}, "same"}]}.
std::string DescribeSwap(const std::string& role, RobotId robot, ProcessId from, ProcessId to, double seconds,
                         const std::map<MapId, HeldMap>& before, const std::map<MapId, HeldMap>& after);

}  // namespace portolan
