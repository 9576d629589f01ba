#include "process/run_output.h"

#include <array>
#include <sstream>

#include "base/atomic_file.h"

namespace portolan {
namespace {

/// Colours of maps, in turn: the first ones of Okabe and Ito's palette, which readers of any colour vision tell apart.
constexpr std::array<std::array<uint8_t, 3>, 6> kMapColours = {
    {{0, 114, 178}, {230, 159, 0}, {0, 158, 115}, {213, 94, 0}, {204, 121, 167}, {86, 180, 233}}};

}  // namespace

Status WritePly(const std::string& path, const RunTrajectories& trajectories,
                const std::map<MapId, MapReplica>& replicas) {
  size_t count = 0;
  for (const auto& [id, number] : trajectories.map_numbers) count += replicas.at(id).map().points().size();
  std::ostringstream file;
  file << "ply\nformat binary_little_endian 1.0\nelement vertex " << count
       << "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty "
          "uchar blue\nend_header\n";
  for (const auto& [id, number] : trajectories.map_numbers) {
    const Map& map = replicas.at(id).map();
    const Sim3d& joined_from_map = trajectories.joined_from_map.at(id);
    const auto& colour = kMapColours[static_cast<size_t>(number) % kMapColours.size()];
    for (const MapPointId point : map.SortedPointIds()) {
      const Eigen::Vector3f position =
          (joined_from_map * map.point(point).position_in_map.cast<double>()).cast<float>();
      file.write(reinterpret_cast<const char*>(position.data()), 3 * sizeof(float));
      file.write(reinterpret_cast<const char*>(colour.data()), 3);
    }
  }
  return WriteFileAtomically(path, file.str());
}

Status WriteRunOutput(const std::string& folder, const RunTrajectories& trajectories,
                      const std::map<MapId, MapReplica>& replicas) {
  const struct {
    const char* name;
    const Trajectory* trajectory;
    bool with_map;
  } files[] = {{"trajectory.txt", &trajectories.joined, false},
               {"trajectory_maps.txt", &trajectories.per_map, true},
               {"trajectory_online.txt", &trajectories.online, true},
               {"keyframes.txt", &trajectories.keyframes, false}};
  for (const auto& file : files) {
    if (Status written = WriteTrajectory(folder + "/" + file.name, *file.trajectory, file.with_map); !written)
      return written;
  }
  return WritePly(folder + "/map.ply", trajectories, replicas);
}

}  // namespace portolan
