#include "process/atlas_config.h"

namespace portolan {

Status ReadAtlasOptions(ConfigReader* config, AtlasOptions* options) {
  config->Read("atlas.store", &options->store);
  config->Read("atlas.store_interval_s", &options->store_interval_s, {0.1, 3600});
  config->Read("atlas.join_maps", &options->join_maps);
  config->Read("atlas.max_waiting", &options->max_waiting, {1, 1000});
  config->Read("atlas.memory_mb", &options->shelf.memory_mb, {1, 1e6});
  config->Read("atlas.maps_mb", &options->shelf.maps_mb, {0, 1e6});
  config->Read("atlas.switch_keyframes", &options->join.switch_keyframes, {0, 1000000});
  config->Read("atlas.retry_keyframes", &options->join.retry_keyframes, {0, 1000000});
  OverlapOptions& overlap = options->overlap;
  config->Read("atlas.max_verified", &overlap.max_verified, {1, 100});
  config->Read("atlas.consistent_rounds", &overlap.consistent_rounds, {0, 100});
  config->Read("atlas.min_word_matches", &overlap.verification.min_word_matches, {4, 1000});
  config->Read("atlas.min_inliers", &overlap.verification.min_inliers, {4, 1000});
  config->Read("atlas.min_share", &overlap.verification.min_share, {0, 1});
  config->Read("atlas.min_weight", &overlap.verification.min_weight, {0, 10000});
  config->Read("atlas.min_agreeing", &overlap.verification.min_agreeing, {0, 100});
  return overlap.Check();
}

std::string StorePath(const AtlasOptions& options, const std::string& out) {
  if (options.store == "none") return "";
  if (!options.store.empty()) return options.store;
  return out.empty() ? "" : out + "/atlas.db";
}

}  // namespace portolan
