#pragma once

#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "map/protocol.h"

namespace portolan {

/// Of a deployment's processes, in the order of the paper's threads (Sec. 2).
inline constexpr std::array<const char*, 4> kRoles = {"frontend_tracker", "backend_mapper", "loop_closer",
                                                      "atlas_server"};

/// What the processes of a deployment tell of themselves, with rates from what they told before; the first status of a
/// process may be an old one that DDS kept, so rates begin with its third. Time is given in seconds of any steady
/// clock.
class StatusBook {
 public:
  void Hear(const ProcessStatus& status, double now_s);

  /// How many processes were heard of.
  size_t size() const { return entries_.size(); }
  /// Whether a process of each of kRoles was heard of.
  bool HasEveryRole() const;
  /// The process of this role heard of last; null if none.
  const ProcessStatus* Find(const std::string& role) const;

  /// As a table, tracker first, robot by robot. Processes that have been silent for longer than kSilentS are marked.
  std::string Format(double now_s) const;
  /// [{process, role, robot, host, pid, vendor, build, priority, state, map, epoch, revision, silent_s, figures,
  /// rates}]
  nlohmann::json ToJson(double now_s) const;

  /// A process that was heard of.
  struct Heard {
    ProcessStatus status;  ///< the last
    double silent_s = 0;
  };
  /// In the order of Format().
  std::vector<Heard> Processes(double now_s) const;

  /// A process publishes its status each second.
  static constexpr double kSilentS = 3.0;
  /// One that was silent for so long is gone for good: a book that is kept for days forgets it.
  static constexpr double kForgottenS = 600.0;

 private:
  struct Entry {
    ProcessStatus status;
    double heard_s = 0;
    std::map<std::string, double> rates;  // per second, of figures that rose since the status before
    int heard = 0;                        // statuses
  };
  std::vector<const Entry*> Sorted() const;

  std::map<ProcessId, Entry> entries_;
};

}  // namespace portolan
