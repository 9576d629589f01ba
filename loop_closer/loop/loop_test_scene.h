#pragma once

#include "map/map.h"
#include "place_recognition/place_test_scene.h"

// What tests of loop closing share: a place seen on two passes, in one map that has drifted between them.

namespace portolan {

/// Where the second pass came out: where it should be, but for this.
inline Sim3d LoopDrift() {
  return Sim3d(1.2, ExpSO3({0.03, -0.06, 0.02}), {0.3, -0.2, 0.3});
}

/// The map after both passes.
inline Map MapWithLoop(const TwoPasses& passes) {
  Map map = BuildMap(passes.first);
  AddPass(passes.second, LoopDrift(), &map);
  return map;
}

}  // namespace portolan
