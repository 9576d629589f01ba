#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "geometry/camera_model.h"
#include "geometry/rigid3.h"

namespace portolan {

/// Number of an ownership of a map, granted by the atlas_server, rising; 0 is "never granted".
using Epoch = uint64_t;
/// Number of a state of a map within an epoch, rising by one with each delta; 0 is the empty map.
using Revision = uint64_t;

/// A change of a map as whole values of what changed: applying one twice does no harm. A snapshot is a delta from
/// revision 0. Applied in this order: removals of points, removals of keyframes, keyframes, points, observations.
struct MapDelta {
  struct KeyFrameState {
    KeyFrameId id;
    Rigid3d camera_from_map;
    KeyFrameId parent;
    uint32_t num_features = 0;  ///< of its data, for validation
  };
  struct PointState {
    MapPointId id;
    Eigen::Vector3f position_in_map;
  };
  struct ObservationState {
    MapPointId point;
    KeyFrameId keyframe;
    int32_t feature = -1;  ///< -1: not seen there (any more)
  };
  struct RemovedPoint {
    MapPointId id;
    MapPointId replaced_by;  ///< the point it was merged into, or none
  };
  struct RemovedKeyFrame {
    KeyFrameId id;
    KeyFrameId anchor;            ///< a keyframe that stays (its parent), for what hung on it
    Rigid3d removed_from_anchor;  ///< camera_from_camera at the time of removal
  };

  MapId map;
  Epoch epoch = 0;
  Revision base_revision = 0;  ///< the state this applies to; 0: a snapshot, which replaces everything
  Revision revision = 0;
  std::vector<CameraResidual> residuals;  ///< all that are known by then, not changes (Map::SetResidual)
  std::vector<RemovedPoint> removed_points;
  std::vector<RemovedKeyFrame> removed_keyframes;
  std::vector<KeyFrameState> keyframes;
  std::vector<PointState> points;
  std::vector<ObservationState> observations;

  bool IsSnapshot() const { return base_revision == 0; }
  bool IsEmpty() const {
    return removed_points.empty() && removed_keyframes.empty() && keyframes.empty() && points.empty() &&
           observations.empty();
  }
};

/// One piece of a delta for the wire: a MapDelta with some of its elements, of the same map, epoch and revisions.
struct MapDeltaChunk {
  uint32_t index = 0;
  uint32_t count = 1;
  MapDelta part;
};

/// Splits a delta into chunks of at most max_elements (summed over its lists); always at least one.
std::vector<MapDeltaChunk> SplitDelta(const MapDelta& delta, size_t max_elements);

/// Puts the chunks of deltas together again. Chunks may come in any order and more than once. Holds what came of
/// unfinished deltas and no more, whatever number of chunks they claim to have.
class DeltaAssembler {
 public:
  /// Of unfinished deltas at a time: some ten million observations, of thirty thousand keyframes.
  static constexpr size_t kMaxPendingBytes = size_t{256} << 20;

  explicit DeltaAssembler(size_t max_pending_bytes = kMaxPendingBytes) : max_pending_bytes_(max_pending_bytes) {}

  /// @return the whole delta when this chunk completes it, else nothing. A chunk whose count contradicts its delta's
  /// starts the delta anew. At most kMaxPending unfinished deltas are kept, the newest, and of those at most
  /// max_pending_bytes: who takes most of the room goes first. Those that go are counted.
  std::vector<MapDelta> Add(MapDeltaChunk chunk);
  uint64_t dropped() const { return dropped_; }
  /// What the unfinished deltas take.
  size_t pending_bytes() const;

 private:
  static constexpr size_t kMaxPending = 8;
  struct Pending {
    MapDelta header;
    uint32_t count = 0;                  // of chunks, as claimed
    std::map<uint32_t, MapDelta> parts;  // by index
    size_t bytes = 0;                    // of the parts
  };
  Pending& PendingOf(const MapDeltaChunk& chunk);
  void MakeRoom();
  void Drop(std::vector<Pending>::iterator pending);

  size_t max_pending_bytes_;
  std::vector<Pending> pending_;  // oldest first
  uint64_t dropped_ = 0;
};

}  // namespace portolan
