#pragma once

#include <string>

#include "base/result.h"

namespace portolan {

/// Writes a whole file or leaves what was there: into a temporary file beside it, flushed to the disk, then renamed.
/// Readers see the old content or the new one. Fails with the path and the system's reason (disk full, no permission,
/// no such folder).
Status WriteFileAtomically(const std::string& path, const std::string& content);

}  // namespace portolan
