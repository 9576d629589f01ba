#include "mapping/mapper_config.h"

namespace portolan {

Status ReadMapperOptions(ConfigReader* config, MapperOptions* options) {
  config->Read("mapper.min_landmarks", &options->min_landmarks, {4, 1000});
  InitializationOptions& initialization = options->initialization;
  config->Read("mapper.initialization.min_points", &initialization.min_points, {10, 10000});
  config->Read("mapper.initialization.sigma_px", &initialization.two_view.sigma_px, {0.1, 10});
  config->Read("mapper.initialization.ransac_iterations", &initialization.two_view.ransac_iterations, {10, 100000});
  config->Read("mapper.initialization.min_parallax_deg", &initialization.two_view.min_parallax_deg, {0.01, 90});
  config->Read("mapper.initialization.ambiguity_ratio", &initialization.two_view.ambiguity_ratio, {0.1, 1});
  config->Read("mapper.initialization.max_direction_sigma_deg", &initialization.two_view.max_direction_sigma_deg,
               {0.01, 90});
  config->Read("mapper.initialization.max_rotation_difference_deg",
               &initialization.two_view.max_rotation_difference_deg, {1, 180});
  PointCreationOptions& creation = options->creation;
  config->Read("mapper.creation.neighbours", &creation.neighbours, {1, 100});
  config->Read("mapper.creation.min_baseline", &creation.min_baseline, {0, 1});
  config->Read("mapper.creation.max_distance", &creation.max_distance, {1, 256});
  FusionOptions& fusion = options->fusion;
  config->Read("mapper.fusion.max_keyframes", &fusion.max_keyframes, {1, 200});
  LocalBundleOptions& bundle = options->bundle;
  config->Read("mapper.bundle.max_keyframes", &bundle.max_keyframes, {2, 200});
  config->Read("mapper.bundle.max_fixed", &bundle.max_fixed, {1, 200});
  config->Read("mapper.bundle.iterations", &bundle.iterations, {1, 100});
  config->Read("mapper.lens.enabled", &options->lens.enabled);
  config->Read("mapper.lens.first_keyframes", &options->lens.first_keyframes, {5, 1000});
  PruningOptions& pruning = options->pruning;
  config->Read("mapper.pruning.redundant_share", &pruning.redundant_share, {0.5, 1});
  config->Read("mapper.pruning.redundant_observers", &pruning.redundant_observers, {2, 100});
  return options->Check();
}

}  // namespace portolan
