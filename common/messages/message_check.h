#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/result.h"

namespace portolan {

/// Text that may be logged, shown on a terminal and put into JSON: valid UTF-8 without control characters other than
/// tab and newline.
bool IsCleanText(const std::string& text);

/// Collects the first reason why a message from the network must be refused.
///
///   MessageCheck check("Command");
///   check.Id("map", map_id);
///   check.Finite("scale", scale);
///   if (!check.ok()) return check.error();
class MessageCheck {
 public:
  explicit MessageCheck(const char* message) : message_(message) {}

  bool ok() const { return reason_.empty(); }
  /// "Command: map is none"; only when not ok.
  Error error() const { return Error{std::string(message_) + ": " + reason_}; }

  /// Refuses with `reason` unless `holds`.
  void Require(bool holds, const std::string& reason);
  void Id(const char* field, uint64_t id);  ///< not "none"
  void Finite(const char* field, double value);
  void AtMost(const char* field, uint64_t value, uint64_t limit);
  void SameLength(const char* field, size_t length, size_t expected);
  void Text(const char* field, const std::string& text, size_t max_bytes);  ///< clean, and not longer
  void Name(const char* field, const std::string& text);                    ///< clean, short and not empty
  void UnitQuaternion(const char* field, const double* xyzw);
  void AllIds(const char* field, const std::vector<uint64_t>& ids);
  void AllFinite(const char* field, const std::vector<double>& values);
  void AllFinite(const char* field, const std::vector<float>& values);

 private:
  const char* message_;
  std::string reason_;
};

}  // namespace portolan
