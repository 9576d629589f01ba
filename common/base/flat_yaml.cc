#include "base/flat_yaml.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <numeric>
#include <optional>
#include <sstream>

namespace portolan {
namespace {

/// Deeper than any file of ours; ends the walk through a document whose alias contains itself.
constexpr int kMaxDepth = 8;

/// Walks the tree of nodes and collects its leaves.
class Flattener {
 public:
  explicit Flattener(std::string name) : name_(std::move(name)) {}

  Status AddMap(const YAML::Node& map, const std::string& prefix, int depth) {
    if (depth > kMaxDepth)
      return Error{fmt::format("{}: '{}' is nested too deep (at most {})", name_, prefix, kMaxDepth)};
    for (const auto& item : map) {
      if (!item.first.IsScalar()) return Error{At(item.first) + "expected a plain word as key"};
      const std::string key = prefix.empty() ? item.first.Scalar() : prefix + "." + item.first.Scalar();
      const int line = item.first.Mark().line + 1;
      const auto [first, is_new] = lines_.emplace(key, line);
      if (!is_new)
        return Error{fmt::format("{}:{}: key '{}' is given twice, first on line {}", name_, line, key, first->second)};
      if (item.second.IsMap()) {
        if (Status added = AddMap(item.second, key, depth + 1); !added) return added;
      } else if (Status added = AddLeaf(item.second, key, line); !added) {
        return added;
      }
    }
    return Ok{};
  }

  std::vector<YamlEntry> TakeEntries() { return std::move(entries_); }

 private:
  std::string At(const YAML::Node& node) const { return fmt::format("{}:{}: ", name_, node.Mark().line + 1); }

  Status AddLeaf(const YAML::Node& node, const std::string& key, int line) {
    YamlEntry entry{key, line, node.IsSequence(), {}};
    if (node.IsScalar()) entry.values.push_back(node.Scalar());
    if (node.IsSequence()) {
      for (const auto& element : node) {
        if (!element.IsScalar()) return Error{fmt::format("{}list '{}' may hold only plain values", At(element), key)};
        entry.values.push_back(element.Scalar());
      }
    }
    entries_.push_back(std::move(entry));
    return Ok{};
  }

  std::string name_;
  std::vector<YamlEntry> entries_;
  std::map<std::string, int> lines_;  ///< of every key and section seen
};

std::optional<std::string> WithoutPlus(const std::string& text) {
  if (text.empty()) return std::nullopt;
  return text[0] == '+' && text.size() > 1 && text[1] != '-' ? text.substr(1) : text;
}

template <class T>
bool ParseWhole(const std::string& text, T* value) {
  const std::optional<std::string> digits = WithoutPlus(text);
  if (!digits) return false;
  T parsed{};
  const char* end = digits->data() + digits->size();
  const auto [stop, failure] = std::from_chars(digits->data(), end, parsed);
  if (failure != std::errc() || stop != end) return false;
  *value = parsed;
  return true;
}

/// Levenshtein's edit distance, one row at a time.
size_t EditDistance(const std::string& a, const std::string& b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 0; i < a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i + 1;
    for (size_t j = 0; j < b.size(); ++j) {
      const size_t replaced = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, diagonal + 1});
    }
  }
  return row.back();
}

}  // namespace

Result<std::vector<YamlEntry>> ParseFlatYaml(const std::string& text, const std::string& name) {
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAll(text);
    if (documents.size() > 1)
      return Error{name + ": expected one YAML document, found " + std::to_string(documents.size())};
    if (documents.empty() || documents[0].IsNull()) return std::vector<YamlEntry>{};
    if (!documents[0].IsMap()) return Error{name + ":1: expected 'key: value' lines"};
    Flattener flattener(name);
    if (Status added = flattener.AddMap(documents[0], "", 0); !added) return added.error();
    return flattener.TakeEntries();
  } catch (const YAML::Exception& failure) {
    return Error{fmt::format("{}:{}: not valid YAML: {}", name, failure.mark.line + 1, failure.msg)};
  }
}

Result<std::string> ReadTextFile(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) return Error{path + ": expected a file, found a folder"};
  std::ifstream file(path, std::ios::binary);
  if (!file) return Error{path + ": can't be opened: " + std::strerror(errno)};
  std::ostringstream text;
  text << file.rdbuf();
  if (file.bad()) return Error{path + ": can't be read: " + std::strerror(errno)};
  return text.str();
}

bool ParseNumber(const std::string& text, double* value) {
  double parsed = 0;
  if (!ParseWhole(text, &parsed) || !std::isfinite(parsed)) return false;
  *value = parsed;
  return true;
}

bool ParseNumber(const std::string& text, int64_t* value) {
  return ParseWhole(text, value);
}

std::string NearestWord(const std::string& word, const std::vector<std::string>& candidates) {
  size_t best_distance = std::max<size_t>(1, word.size() / 3) + 1;
  std::string best;
  for (const std::string& candidate : candidates) {
    const size_t distance = EditDistance(word, candidate);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = candidate;
  }
  return best;
}

}  // namespace portolan
