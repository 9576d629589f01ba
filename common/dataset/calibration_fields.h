#pragma once

#include <string>
#include <vector>

#include "base/flat_yaml.h"
#include "base/result.h"

namespace portolan {

/// The keys of one calibration file, asked for one by one. The first mistake is kept and told by Check(); what is read
/// after it has no meaning.
class CalibrationFields {
 public:
  CalibrationFields(std::string path, std::vector<YamlEntry> entries)
      : path_(std::move(path)), entries_(std::move(entries)) {}

  bool Has(const std::string& key) const { return Find(key) != nullptr; }
  /// A finite number, or one above 0; missing or anything else is a mistake.
  double Number(const std::string& key);
  double Positive(const std::string& key);
  double NumberOr(const std::string& key, double absent) { return Has(key) ? Number(key) : absent; }
  double PositiveOr(const std::string& key, double absent) { return Has(key) ? Positive(key) : absent; }
  /// A whole number of pixels, 1 or more.
  int Pixels(const std::string& key);
  std::string Text(const std::string& key);
  /// Finite numbers; a mistake if their count is not among `counts`.
  std::vector<double> Numbers(const std::string& key, const std::vector<size_t>& counts);
  /// Every key must be one of these.
  void AllowOnly(const std::vector<std::string>& keys);
  /// Notes a mistake: "path:line: key: expected ..., found ...".
  void AddMistake(const std::string& key, const std::string& expected);

  Status Check() const;
  const std::string& path() const { return path_; }

 private:
  const YamlEntry* Find(const std::string& key) const;
  bool ParseScalar(const std::string& key, double* value) const;

  std::string path_;
  std::vector<YamlEntry> entries_;
  std::string mistake_;
};

}  // namespace portolan
