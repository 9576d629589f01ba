#pragma once

#include <map>
#include <vector>

#include "base/ids.h"
#include "dataset/trajectory_io.h"
#include "geometry/sim3.h"
#include "map/map_replica.h"
#include "tracking/frame_history.h"
#include "tracking/link_graph.h"

namespace portolan {

/// The trajectories of a run, from the tracked frames and the maps as they are now. Maps are numbered from 0 in the
/// order in which the camera came into them.
struct RunTrajectories {
  Trajectory joined;   ///< every tracked frame, in the first map's frame
  Trajectory per_map;  ///< the same in each map's own frame, with its number
  /// As known when the frame was tracked; only frames tracked at their time, with the map's number.
  Trajectory online;
  Trajectory keyframes;  ///< of all maps, joined
  std::map<MapId, int> map_numbers;
  std::map<MapId, Sim3d> joined_from_map;
  std::vector<MapId> unlinked_maps;  ///< that no chain of links connects with any map before: where they lie is assumed
};

/// A map's place in the joined frame comes from the links, along the fewest of them from the first map. One that is
/// linked to none of those before is hung on by assumption: the camera went on from where it was last, at the mean of
/// the velocities on both sides of the gap, turned as dead reckoning says, as fast as before (median speed over
/// kSpeedFrames frames on each side gives the scale).
RunTrajectories MakeTrajectories(const FrameHistory& history, const std::map<MapId, MapReplica>& replicas,
                                 const LinkGraph& links);

}  // namespace portolan
