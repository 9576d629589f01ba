#include "base/config_reader.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace portolan {
namespace {

template <class T>
std::string Describe(const char* what, Limits<T> limits) {
  const Limits<T> none;
  if (limits.min == none.min && limits.max == none.max) return what;
  if (limits.max == none.max) return fmt::format("{}, {} or more", what, limits.min);
  if (limits.min == none.min) return fmt::format("{}, {} or less", what, limits.max);
  return fmt::format("{} from {} to {}", what, limits.min, limits.max);
}

template <class T>
bool ParseWithin(const std::string& text, Limits<T> limits, T* value) {
  T parsed{};
  if (!ParseNumber(text, &parsed) || parsed < limits.min || parsed > limits.max) return false;
  *value = parsed;
  return true;
}

bool StartsWith(const std::string& text, const std::string& start) {
  return text.compare(0, start.size(), start) == 0;
}

bool ParseBool(const std::string& text, bool* value) {
  if (text != "true" && text != "false") return false;
  *value = text == "true";
  return true;
}

}  // namespace

Result<ConfigReader> ConfigReader::FromFile(const std::string& path) {
  Result<std::string> text = ReadTextFile(path);
  if (!text) return text.error();
  return FromText(*text, path);
}

Result<ConfigReader> ConfigReader::FromText(const std::string& text, const std::string& name) {
  Result<std::vector<YamlEntry>> entries = ParseFlatYaml(text, name);
  if (!entries) return entries.error();
  ConfigReader reader;
  for (YamlEntry& entry : *entries) {
    const std::string where = fmt::format("{}:{}", name, entry.line);
    reader.entries_[entry.key] = Entry{entry, where};
  }
  return reader;
}

Status ConfigReader::Set(const std::string& assignment) {
  const size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) {
    return Error{fmt::format("--set {}: expected key=value, as in tracker.num_features=1500", assignment)};
  }
  const std::string key = assignment.substr(0, equals);
  const std::string value = assignment.substr(equals + 1);
  Result<std::vector<YamlEntry>> parsed = ParseFlatYaml("value: " + value, "--set " + key);
  if (!parsed || parsed->size() != 1 || (*parsed)[0].key != "value") {
    return Error{fmt::format("--set {}: expected a plain value or a list [a, b] after '='", assignment)};
  }
  YamlEntry entry = (*parsed)[0];
  entry.key = key;
  entries_[key] = Entry{std::move(entry), "--set"};
  return Ok{};
}

void ConfigReader::Read(const std::string& key, bool* value) {
  const std::string expected = "true or false";
  const std::string* text = FindScalar(key, expected);
  if (text && !ParseBool(*text, value)) AddMistake(entries_.at(key), expected);
}

void ConfigReader::Read(const std::string& key, int* value, Limits<int> limits) {
  int64_t wide = *value;
  Read(key, &wide, Limits<int64_t>{limits.min, limits.max});
  *value = static_cast<int>(wide);
}

void ConfigReader::Read(const std::string& key, int64_t* value, Limits<int64_t> limits) {
  const std::string expected = Describe("a whole number", limits);
  const std::string* text = FindScalar(key, expected);
  if (text && !ParseWithin(*text, limits, value)) AddMistake(entries_.at(key), expected);
}

void ConfigReader::Read(const std::string& key, double* value, Limits<double> limits) {
  const std::string expected = Describe("a finite number", limits);
  const std::string* text = FindScalar(key, expected);
  if (text && !ParseWithin(*text, limits, value)) AddMistake(entries_.at(key), expected);
}

void ConfigReader::Read(const std::string& key, std::string* value) {
  if (const std::string* text = FindScalar(key, "text")) *value = *text;
}

void ConfigReader::Read(const std::string& key, std::vector<std::string>* value) {
  const Entry* entry = Find(key);
  if (!entry) return;
  if (entry->yaml.is_list) {
    *value = entry->yaml.values;
  } else {
    AddMistake(*entry, "a list [a, b, ...]");
  }
}

void ConfigReader::ReadChoice(const std::string& key, std::string* value, const std::vector<std::string>& choices) {
  const std::string expected = fmt::format("one of {}", fmt::join(choices, ", "));
  const std::string* text = FindScalar(key, expected);
  if (!text) return;
  if (std::find(choices.begin(), choices.end(), *text) != choices.end()) {
    *value = *text;
  } else {
    AddMistake(entries_.at(key), expected);
  }
}

Status ConfigReader::Finish() const {
  std::vector<std::string> mistakes = mistakes_;
  for (const auto& [key, entry] : entries_) {
    const bool is_known = std::find(known_.begin(), known_.end(), key) != known_.end();
    const bool is_empty_section = entry.yaml.values.empty() && !entry.yaml.is_list && IsSection(key);
    if (is_known || is_empty_section || IsIgnored(key)) continue;
    mistakes.push_back(fmt::format("{}: unknown key '{}'{}", entry.where, key, Suggestion(key)));
  }
  if (mistakes.empty()) return Ok{};
  return Error{fmt::format("{}", fmt::join(mistakes, "\n"))};
}

const ConfigReader::Entry* ConfigReader::Find(const std::string& key) {
  known_.push_back(key);
  const auto found = entries_.find(key);
  return found == entries_.end() ? nullptr : &found->second;
}

const std::string* ConfigReader::FindScalar(const std::string& key, const std::string& expected) {
  const Entry* entry = Find(key);
  if (!entry) return nullptr;
  if (!entry->yaml.is_list && entry->yaml.values.size() == 1) return &entry->yaml.values[0];
  AddMistake(*entry, expected);
  return nullptr;
}

void ConfigReader::AddMistake(const Entry& entry, const std::string& expected) {
  const YamlEntry& yaml = entry.yaml;
  const std::string value = yaml.is_list          ? fmt::format("[{}]", fmt::join(yaml.values, ", "))
                            : yaml.values.empty() ? std::string("nothing")
                                                  : "'" + yaml.values[0] + "'";
  mistakes_.push_back(fmt::format("{}: {}: expected {}, found {}", entry.where, yaml.key, expected, value));
}

bool ConfigReader::IsIgnored(const std::string& key) const {
  return std::any_of(ignored_.begin(), ignored_.end(),
                     [&](const std::string& section) { return key == section || StartsWith(key, section + "."); });
}

bool ConfigReader::IsSection(const std::string& key) const {
  return std::any_of(known_.begin(), known_.end(),
                     [&](const std::string& known) { return StartsWith(known, key + "."); });
}

std::string ConfigReader::Suggestion(const std::string& key) const {
  const std::string nearest = NearestWord(key, known_);
  if (!nearest.empty()) return fmt::format("; did you mean '{}'?", nearest);
  const std::string section = NearestWord(key.substr(0, key.find('.')), ignored_);
  return section.empty() ? "" : fmt::format("; did you mean section '{}'?", section);
}

}  // namespace portolan
