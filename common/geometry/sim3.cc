#include "geometry/sim3.h"

namespace portolan {

Rigid3d TransformPose(const Rigid3d& camera_from_a, const Sim3d& b_from_a) {
  const Sim3d camera_from_b = Sim3d(camera_from_a) * b_from_a.Inverse();
  return Rigid3d(camera_from_b.rotation, camera_from_b.translation / camera_from_b.scale);  // paper Eq. (13)
}

}  // namespace portolan
