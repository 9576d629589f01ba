#pragma once

#include "base/config_reader.h"
#include "mapping/mapper_options.h"

namespace portolan {

/// Reads and checks the section mapper.
Status ReadMapperOptions(ConfigReader* config, MapperOptions* options);

}  // namespace portolan
