#include "process/atlas_config.h"

namespace portolan {

Status ReadAtlasOptions(ConfigReader* config, AtlasOptions* options) {
  config->Read("atlas.store", &options->store);
  config->Read("atlas.store_interval_s", &options->store_interval_s, {0.1, 3600});
  return Ok{};
}

std::string StorePath(const AtlasOptions& options, const std::string& out) {
  if (options.store == "none") return "";
  if (!options.store.empty()) return options.store;
  return out.empty() ? "" : out + "/atlas.db";
}

}  // namespace portolan
