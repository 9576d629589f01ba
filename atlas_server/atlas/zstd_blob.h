#pragma once

#include <string>
#include <string_view>

#include "base/result.h"

namespace portolan {

/// Bytes as one zstd frame with zstd's own checksum.
std::string Compress(std::string_view bytes);

/// @param most the result's bytes at most. Fails, without taking more memory than that, on anything that is not one
/// whole frame.
Result<std::string> Decompress(std::string_view frame, size_t most);

}  // namespace portolan
