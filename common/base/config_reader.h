#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "base/flat_yaml.h"
#include "base/result.h"

namespace portolan {

/// Inclusive limits of an option.
template <class T>
struct Limits {
  T min = std::numeric_limits<T>::lowest();
  T max = std::numeric_limits<T>::max();
};

/// Reads one YAML file of nested sections, which configures every process of a run, into typed options. Defaults live
/// in code: a key that is absent leaves the option as it is.
///
///   Result<ConfigReader> reader = ConfigReader::FromFile(path);        // or ConfigReader() without a file
///   for (const std::string& assignment : set_arguments) if (Status set = reader->Set(assignment); !set) ...
///   reader->Read("tracker.num_features", &options.num_features, {100, 20000});
///   reader->ReadChoice("dds.vendor", &options.vendor, {"fastdds", "cyclonedds"});
///   reader->Ignore("mapper");                                           // another process reads and checks that
///   section if (Status finished = reader->Finish(); !finished) ...              // every mistake of the file at once
///
/// Read() never fails: mistakes are collected and Finish() tells them all, one a line, as "file:line: key: ...". Not
/// thread-safe.
class ConfigReader {
 public:
  /// No file: every option has its default, Set() may change it.
  ConfigReader() = default;
  /// Fails on a file that can't be read and whatever ParseFlatYaml refuses (bad syntax, a key given twice).
  static Result<ConfigReader> FromFile(const std::string& path);
  /// @param name how messages call the text.
  static Result<ConfigReader> FromText(const std::string& text, const std::string& name);

  /// Overrides one value, as the command line's `--set key=value` does; the value is YAML ("[a, b]" is a list). The
  /// last one counts. Fails when there is no '=', no key, or the value is not a scalar or list.
  Status Set(const std::string& assignment);

  void Read(const std::string& key, bool* value);
  void Read(const std::string& key, int* value, Limits<int> limits = {});
  void Read(const std::string& key, int64_t* value, Limits<int64_t> limits = {});
  /// NaN and infinity are refused whatever the limits.
  void Read(const std::string& key, double* value, Limits<double> limits = {});
  void Read(const std::string& key, std::string* value);
  void Read(const std::string& key, std::vector<std::string>* value);
  /// A word out of a set.
  void ReadChoice(const std::string& key, std::string* value, const std::vector<std::string>& choices);

  /// Whether the file or Set() gives the key.
  bool Has(const std::string& key) const { return entries_.count(key) > 0; }

  /// Passes over a whole section ("mapper" stands for all "mapper.*"), because another process reads it.
  void Ignore(const std::string& section) { ignored_.push_back(section); }

  /// Tells every mistake: values of a wrong type or out of range, and keys that nobody read (with the nearest known
  /// key).
  Status Finish() const;

 private:
  struct Entry {
    YamlEntry yaml;
    std::string where;  ///< "file:line" or "--set"
  };

  const Entry* Find(const std::string& key);
  const std::string* FindScalar(const std::string& key, const std::string& expected);
  void AddMistake(const Entry& entry, const std::string& expected);
  bool IsIgnored(const std::string& key) const;
  /// Whether keys of a section of this name were asked for.
  bool IsSection(const std::string& key) const;
  std::string Suggestion(const std::string& key) const;

  std::map<std::string, Entry> entries_;
  std::vector<std::string> known_;  ///< keys asked for so far
  std::vector<std::string> ignored_;
  std::vector<std::string> mistakes_;
};

}  // namespace portolan
