#include "dataset/calibration_fields.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace portolan {

double CalibrationFields::Number(const std::string& key) {
  double value = 0;
  if (!ParseScalar(key, &value)) AddMistake(key, "a finite number");
  return value;
}

double CalibrationFields::Positive(const std::string& key) {
  double value = 0;
  if (!ParseScalar(key, &value) || value <= 0) AddMistake(key, "a finite number above 0");
  return value;
}

int CalibrationFields::Pixels(const std::string& key) {
  constexpr int64_t kMaxPixels = 65535;  // what a JPEG can hold
  const YamlEntry* entry = Find(key);
  int64_t value = 0;
  const bool is_whole = entry && !entry->is_list && entry->values.size() == 1 && ParseNumber(entry->values[0], &value);
  if (!is_whole || value < 1 || value > kMaxPixels) AddMistake(key, "a whole number of pixels from 1 to 65535");
  return static_cast<int>(value);
}

std::string CalibrationFields::Text(const std::string& key) {
  const YamlEntry* entry = Find(key);
  if (entry && !entry->is_list && entry->values.size() == 1) return entry->values[0];
  AddMistake(key, "a word");
  return "";
}

std::vector<double> CalibrationFields::Numbers(const std::string& key, const std::vector<size_t>& counts) {
  const YamlEntry* entry = Find(key);
  std::vector<double> numbers(entry ? entry->values.size() : 0);
  bool good = entry && entry->is_list && std::find(counts.begin(), counts.end(), numbers.size()) != counts.end();
  for (size_t i = 0; good && i < numbers.size(); ++i) good = ParseNumber(entry->values[i], &numbers[i]);
  if (!good) {
    AddMistake(key, fmt::format("a list of {} finite numbers", fmt::join(counts, " or ")));
    numbers.assign(counts.back(), 0);
  }
  return numbers;
}

void CalibrationFields::AllowOnly(const std::vector<std::string>& keys) {
  for (const YamlEntry& entry : entries_) {
    if (std::find(keys.begin(), keys.end(), entry.key) != keys.end()) continue;
    const std::string nearest = NearestWord(entry.key, keys);
    if (!mistake_.empty()) continue;
    mistake_ =
        fmt::format("{}:{}: unknown key '{}'", path_, entry.line, entry.key) +
        (nearest.empty() ? fmt::format("; known are {}", fmt::join(keys, ", ")) : "; did you mean '" + nearest + "'?");
  }
}

void CalibrationFields::AddMistake(const std::string& key, const std::string& expected) {
  if (!mistake_.empty()) return;
  const YamlEntry* entry = Find(key);
  if (!entry) {
    mistake_ = fmt::format("{}: key '{}' is missing; expected {}", path_, key, expected);
  } else {
    mistake_ = fmt::format("{}:{}: {}: expected {}, found '{}'", path_, entry->line, key, expected,
                           fmt::join(entry->values, ", "));
  }
}

Status CalibrationFields::Check() const {
  if (!mistake_.empty()) return Error{mistake_};
  return Ok{};
}

const YamlEntry* CalibrationFields::Find(const std::string& key) const {
  const auto found =
      std::find_if(entries_.begin(), entries_.end(), [&](const YamlEntry& entry) { return entry.key == key; });
  return found == entries_.end() ? nullptr : &*found;
}

bool CalibrationFields::ParseScalar(const std::string& key, double* value) const {
  const YamlEntry* entry = Find(key);
  return entry && !entry->is_list && entry->values.size() == 1 && ParseNumber(entry->values[0], value);
}

}  // namespace portolan
