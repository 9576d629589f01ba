#include "geometry/sim3.h"

namespace portolan {

Rigid3d MakeRigid(const Sim3d& camera_from_map) {
  return Rigid3d(camera_from_map.rotation.normalized(), camera_from_map.translation / camera_from_map.scale);
}

Rigid3d TransformPose(const Rigid3d& camera_from_a, const Sim3d& b_from_a) {
  return MakeRigid(Sim3d(camera_from_a) * b_from_a.Inverse());
}

}  // namespace portolan
