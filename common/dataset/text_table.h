#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/time.h"

namespace portolan {

/// One line of a text file, split at blanks, tabs and commas.
struct TextRow {
  int line = 0;  ///< from 1
  std::vector<std::string> fields;
};

/// Reads a text file of columns. Lines that are empty or start with '#' are passed over; Windows line ends are
/// accepted. Fails on a file that can't be read.
Result<std::vector<TextRow>> ReadTextTable(const std::string& path);

/// A time in seconds ("1403636579.763555527", "1.037359e-01") to integer nanoseconds; plain decimals are exact, never
/// through a double. None if it is no number, or beyond the range of a Timestamp (292 years around 1970).
std::optional<Timestamp> ParseSeconds(const std::string& text);

/// A time in whole nanoseconds.
std::optional<Timestamp> ParseNanoseconds(const std::string& text);

/// Seconds with nine decimals: the exact inverse of ParseSeconds.
std::string FormatSeconds(Timestamp stamp);

}  // namespace portolan
