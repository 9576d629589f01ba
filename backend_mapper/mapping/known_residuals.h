#pragma once

#include <optional>
#include <vector>

#include "geometry/camera_model.h"
#include "map/map.h"

namespace portolan {

/// What the calibrations of cameras left, as far as a mapper knows: one residual a camera for all its maps, so that
/// maps that are to become one agree.
class KnownResiduals {
 public:
  /// An estimate that is newer than the one before. One that is none is passed over.
  void Set(const CameraResidual& known);
  /// From a map that another owner made: of cameras of which nothing is known yet, what the youngest keyframes had
  /// taken out.
  void Learn(const Map& map);
  /// The first that keyframes of the map still have in their features, or had taken out in another form; none if there
  /// is none.
  std::optional<CameraResidual> FindLacking(const Map& map) const;

 private:
  const RadialResidual* Find(const PinholeCamera& camera) const;

  std::vector<CameraResidual> known_;
};

}  // namespace portolan
