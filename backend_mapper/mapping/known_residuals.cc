#include "mapping/known_residuals.h"

#include <algorithm>

namespace portolan {

void KnownResiduals::Set(const CameraResidual& known) {
  if (known.residual.IsNone()) return;
  const auto same = std::find_if(known_.begin(), known_.end(),
                                 [&](const CameraResidual& other) { return other.camera == known.camera; });
  if (same == known_.end()) {
    known_.push_back(known);
  } else {
    same->residual = known.residual;
  }
}

void KnownResiduals::Learn(const Map& map) {
  KnownResiduals learned;
  for (const auto& [id, keyframe] : map.keyframes()) {  // the youngest last
    if (Find(keyframe.data->camera) == nullptr) learned.Set({keyframe.data->camera, keyframe.data->residual});
  }
  known_.insert(known_.end(), learned.known_.begin(), learned.known_.end());
}

std::optional<CameraResidual> KnownResiduals::FindLacking(const Map& map) const {
  for (const auto& [id, keyframe] : map.keyframes()) {
    const RadialResidual* known = Find(keyframe.data->camera);
    if (known != nullptr && !(*known == keyframe.data->residual)) return CameraResidual{keyframe.data->camera, *known};
  }
  return std::nullopt;
}

const RadialResidual* KnownResiduals::Find(const PinholeCamera& camera) const {
  for (const CameraResidual& known : known_) {
    if (known.camera == camera) return &known.residual;
  }
  return nullptr;
}

}  // namespace portolan
