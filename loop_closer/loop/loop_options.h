#pragma once

#include "base/config_reader.h"
#include "base/result.h"
#include "loop/forward_bundle_adjustment.h"
#include "loop/loop_detector.h"
#include "map_optimization/global_bundle_adjustment.h"
#include "map_optimization/loop_correction.h"

namespace portolan {

/// All of loop closing's parameters.
struct LoopOptions {
  bool enabled = true;               ///< off: the maps are followed, and nothing else
  bool global_ba = true;             ///< after each closed loop
  bool forward_ba = true;            ///< FBA in idle times
  int forward_every_keyframes = 20;  ///< "several key frames" (paper Sec. 5) since the last FBA or loop
  int max_waiting = 5;  ///< keyframes that wait to be looked at; of more the newest: a place is seen by many
  LoopDetectorOptions detector;
  LoopCorrectionOptions correction;
  KeyFrameAdjustmentOptions global;
  ForwardBundleOptions forward;

  Status Check() const;
};

/// Reads the section `loop`; ranges are in docs/configuration.md.
Status ReadLoopOptions(ConfigReader* config, LoopOptions* options);

}  // namespace portolan
