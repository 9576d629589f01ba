#pragma once

#include "base/result.h"
#include "dataset/media_module.h"

namespace portolan {

/// OpenCV's codecs, loaded at the first call: PORTOLAN_MEDIA if that is set, else ../lib/portolan/libportolan_media.so
/// beside the program, else where it was built. Fails, saying what was tried. Thread-safe; a failure is tried again.
Result<const MediaModule*> LoadMediaModule();

}  // namespace portolan
