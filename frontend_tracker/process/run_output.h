#pragma once

#include <string>

#include "base/result.h"
#include "tracking/joined_trajectory.h"

namespace portolan {

/// Writes trajectory.txt, trajectory_maps.txt, trajectory_online.txt, keyframes.txt and map.ply into a folder.
Status WriteRunOutput(const std::string& folder, const RunTrajectories& trajectories,
                      const std::map<MapId, MapReplica>& replicas);

/// Writes the points of all maps, in the joined frame, as a binary PLY with one colour a map.
Status WritePly(const std::string& path, const RunTrajectories& trajectories,
                const std::map<MapId, MapReplica>& replicas);

}  // namespace portolan
