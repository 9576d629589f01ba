#include "messages/message_check.h"

#include <algorithm>
#include <cmath>

#include "messages/limits.h"

namespace portolan {
namespace {

/// How far a quaternion's norm may be from 1: far above rounding of doubles, far below what would bend a rotation.
constexpr double kUnitTolerance = 1e-6;

/// Bytes that follow a lead byte in UTF-8, or -1 if it can't lead. Source: RFC 3629.
int FollowingBytes(unsigned char lead) {
  if (lead < 0x80) return 0;
  if (lead >= 0xc2 && lead <= 0xdf) return 1;
  if (lead >= 0xe0 && lead <= 0xef) return 2;
  if (lead >= 0xf0 && lead <= 0xf4) return 3;
  return -1;
}

/// Overlong forms, surrogates and values beyond U+10FFFF show in the byte after the lead. Source: RFC 3629, Sec. 4.
bool IsAllowedSecondByte(unsigned char lead, unsigned char second) {
  if (lead == 0xe0) return second >= 0xa0;
  if (lead == 0xed) return second <= 0x9f;
  if (lead == 0xf0) return second >= 0x90;
  if (lead == 0xf4) return second <= 0x8f;
  return true;
}

bool IsControl(unsigned char byte) {
  return (byte < 0x20 && byte != '\n' && byte != '\t') || byte == 0x7f;
}

}  // namespace

bool IsCleanText(const std::string& text) {
  for (size_t i = 0; i < text.size(); ++i) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const int following = FollowingBytes(lead);
    if (following < 0 || IsControl(lead) || i + static_cast<size_t>(following) >= text.size()) return false;
    for (int k = 1; k <= following; ++k) {
      const auto byte = static_cast<unsigned char>(text[++i]);
      if ((byte & 0xc0) != 0x80 || (k == 1 && !IsAllowedSecondByte(lead, byte))) return false;
    }
  }
  return true;
}

void MessageCheck::Require(bool holds, const std::string& reason) {
  if (!holds && reason_.empty()) reason_ = reason;
}

void MessageCheck::Id(const char* field, uint64_t id) {
  if (id == 0) Require(false, std::string(field) + " is none");
}

void MessageCheck::Finite(const char* field, double value) {
  if (!std::isfinite(value)) Require(false, std::string(field) + " is not finite");
}

void MessageCheck::AtMost(const char* field, uint64_t value, uint64_t limit) {
  if (value > limit)
    Require(false,
            std::string(field) + " is " + std::to_string(value) + ", at most " + std::to_string(limit) + " expected");
}

void MessageCheck::SameLength(const char* field, size_t length, size_t expected) {
  if (length != expected) {
    Require(false, std::string(field) + " has " + std::to_string(length) + " elements, " + std::to_string(expected) +
                       " expected");
  }
}

void MessageCheck::Text(const char* field, const std::string& text, size_t max_bytes) {
  AtMost((std::string("length of ") + field).c_str(), text.size(), max_bytes);
  if (ok() && !IsCleanText(text)) Require(false, std::string(field) + " holds control characters or is not UTF-8");
}

void MessageCheck::Name(const char* field, const std::string& text) {
  Text(field, text, kMaxNameBytes);
  Require(!text.empty(), std::string(field) + " is empty");
}

void MessageCheck::UnitQuaternion(const char* field, const double* xyzw) {
  const double norm = std::sqrt(xyzw[0] * xyzw[0] + xyzw[1] * xyzw[1] + xyzw[2] * xyzw[2] + xyzw[3] * xyzw[3]);
  if (!(std::abs(norm - 1.0) <= kUnitTolerance)) {  // also when it is NaN
    Require(false, std::string(field) + ": quaternion of norm " + std::to_string(norm) + ", 1 expected");
  }
}

void MessageCheck::AllIds(const char* field, const std::vector<uint64_t>& ids) {
  if (std::find(ids.begin(), ids.end(), 0u) != ids.end())
    Require(false, std::string(field) + " holds an id that is none");
}

void MessageCheck::AllFinite(const char* field, const std::vector<double>& values) {
  if (!std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); })) {
    Require(false, std::string(field) + " holds a value that is not finite");
  }
}

void MessageCheck::AllFinite(const char* field, const std::vector<float>& values) {
  if (!std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); })) {
    Require(false, std::string(field) + " holds a value that is not finite");
  }
}

}  // namespace portolan
