#pragma once

#include <map>
#include <string>
#include <vector>

namespace portolan {

/// The p-quantile (0 to 1) of values by linear interpolation between order statistics; 0 for none.
double Quantile(std::vector<double> values, double p);

/// Milliseconds spent per named stage of a repeated work, kept for a summary (median and p95).
class StageTimes {
 public:
  void Add(const std::string& stage, double milliseconds) { samples_[stage].push_back(milliseconds); }
  const std::map<std::string, std::vector<double>>& samples() const { return samples_; }

 private:
  std::map<std::string, std::vector<double>> samples_;
};

}  // namespace portolan
