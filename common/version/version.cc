#include "version/version.h"

namespace portolan {

std::string BuildDescription() {
  const std::string commit = PORTOLAN_COMMIT;
  return PORTOLAN_VERSION " " + (commit.empty() ? "" : commit + " ") + PORTOLAN_BUILD_TYPE;
}

}  // namespace portolan
