#include "loop/loop_options.h"

namespace portolan {

Status LoopOptions::Check() const {
  return detector.Check();
}

Status ReadLoopOptions(ConfigReader* config, LoopOptions* options) {
  config->Read("loop.enabled", &options->enabled);
  config->Read("loop.global_ba", &options->global_ba);
  config->Read("loop.forward_ba", &options->forward_ba);
  config->Read("loop.forward_every_keyframes", &options->forward_every_keyframes, {5, 100000});
  config->Read("loop.max_waiting", &options->max_waiting, {1, 1000});
  LoopDetectorOptions& detector = options->detector;
  config->Read("loop.min_keyframes", &detector.min_keyframes, {2, 100000});
  config->Read("loop.min_keyframes_between", &detector.min_keyframes_between, {0, 100000});
  config->Read("loop.consistent_rounds", &detector.consistent_rounds, {0, 100});
  config->Read("loop.max_verified", &detector.max_verified, {1, 100});
  config->Read("loop.max_drift_share", &detector.max_drift_share, {0.001, 100});
  config->Read("loop.max_scale_change", &detector.max_scale_change, {1.001, 100});
  Sim3VerificationOptions& verification = detector.verification;
  config->Read("loop.min_word_matches", &verification.min_word_matches, {4, 1000});
  config->Read("loop.min_inliers", &verification.min_inliers, {4, 1000});
  config->Read("loop.min_group_inliers", &verification.min_group_inliers, {4, 10000});
  config->Read("loop.min_share", &verification.min_share, {0, 1});
  config->Read("loop.min_weight", &verification.min_weight, {0, 10000});
  return options->Check();
}

}  // namespace portolan
