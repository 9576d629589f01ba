#include "dataset/text_table.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <sstream>

#include "base/flat_yaml.h"

namespace portolan {
namespace {

constexpr int64_t kNanosecondsPerSecond = 1000000000;
/// Whole seconds that fit a Timestamp's 64 bits of nanoseconds.
constexpr int64_t kMaxSeconds = 9223372035;

bool AllDigits(const std::string& text) {
  return !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
}

/// "123.456" without sign and exponent.
std::optional<int64_t> ParsePlainSeconds(const std::string& text) {
  const size_t point = text.find('.');
  const std::string whole = text.substr(0, point);
  std::string fraction = point == std::string::npos ? "" : text.substr(point + 1);
  if (!AllDigits(whole) || (!fraction.empty() && !AllDigits(fraction))) return std::nullopt;
  int64_t seconds = 0;
  if (!ParseNumber(whole, &seconds) || seconds > kMaxSeconds) return std::nullopt;
  const bool round_up = fraction.size() > 9 && fraction[9] >= '5';
  fraction.resize(9, '0');
  int64_t nanoseconds = 0;
  if (!ParseNumber(fraction, &nanoseconds)) return std::nullopt;
  return seconds * kNanosecondsPerSecond + nanoseconds + (round_up ? 1 : 0);
}

}  // namespace

Result<std::vector<TextRow>> ReadTextTable(const std::string& path) {
  Result<std::string> text = ReadTextFile(path);
  if (!text) return text.error();
  std::istringstream stream(*text);
  std::vector<TextRow> rows;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    for (char& letter : line) {
      if (letter == ',' || letter == '\r') letter = ' ';
    }
    std::istringstream words(line);
    TextRow row{number, {}};
    for (std::string word; words >> word;) row.fields.push_back(word);
    if (!row.fields.empty() && row.fields[0][0] != '#') rows.push_back(std::move(row));
  }
  return rows;
}

std::optional<Timestamp> ParseSeconds(const std::string& text) {
  const bool negative = !text.empty() && text[0] == '-';
  if (const auto plain = ParsePlainSeconds(negative ? text.substr(1) : text))
    return Timestamp{negative ? -*plain : *plain};
  double seconds = 0;
  if (!ParseNumber(text, &seconds) || std::abs(seconds) > static_cast<double>(kMaxSeconds)) return std::nullopt;
  return Timestamp::FromSeconds(seconds);
}

std::optional<Timestamp> ParseNanoseconds(const std::string& text) {
  Timestamp stamp;
  if (!ParseNumber(text, &stamp.ns)) return std::nullopt;
  return stamp;
}

std::string FormatSeconds(Timestamp stamp) {
  const lldiv_t parts = std::lldiv(stamp.ns, kNanosecondsPerSecond);
  const char* sign = stamp.ns < 0 ? "-" : "";
  return fmt::format("{}{}.{:09}", sign, std::llabs(parts.quot), std::llabs(parts.rem));
}

}  // namespace portolan
