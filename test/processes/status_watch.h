#pragma once

#include <sys/types.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "transport/bus.h"

namespace portolan {

/// Reads what the processes of a deployment tell of themselves, so that tests wait for what happens and not for time.
class StatusWatch {
 public:
  /// What has been heard so far.
  struct Heard {
    std::map<ProcessId, ProcessStatus> processes;  ///< the last of each
    std::optional<TrackerState> tracker;           ///< the last
    int alive = 0;                                 ///< processes whose liveliness holds now
    /// The last status of the process of this role that was heard of last; null if none.
    const ProcessStatus* Of(const std::string& role) const;
    /// Of one process; null if it has told nothing.
    const ProcessStatus* OfPid(pid_t pid) const;
    /// A figure of that status; 0 if there is none.
    double Figure(const std::string& role, const std::string& name) const;
    /// Whether the tracker has come to this frame.
    bool TrackerIsAt(uint64_t frame) const { return tracker && tracker->frame >= frame; }
    std::map<std::string, ProcessId> last_of_role;
  };

  StatusWatch(DdsVendor vendor, int domain);
  explicit StatusWatch(const BusOptions& options);

  /// @return whether the condition came true before the deadline.
  bool WaitUntil(const std::function<bool(const Heard&)>& condition, std::chrono::milliseconds deadline);
  Heard heard() const;
  Bus* bus() { return bus_.get(); }

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Heard heard_;
  std::unique_ptr<Bus> bus_;
  std::unique_ptr<Reader> status_reader_, tracker_reader_;  // last: stop before what they write to goes
};

/// A figure of a status; 0 if there is none.
double FigureOf(const ProcessStatus& status, const std::string& name);

/// The bus options of a participant beside the processes of robot 0.
BusOptions TestBusOptions(DdsVendor vendor, int domain);

}  // namespace portolan
