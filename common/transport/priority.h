#pragma once

#include <string>

#include "base/result.h"

namespace portolan {

/// How a process stands towards the others on its machine (paper: tracking highest, multiple mapping lowest).
struct PriorityOptions {
  int nice = 0;      ///< -20 (first) to 19 (last); below 0 needs CAP_SYS_NICE or an rlimit
  int realtime = 0;  ///< SCHED_RR priority 1 to 99; 0: not real-time. Where it is not permitted, nice holds.
  Status Check() const;
};

/// Sets the priority of the calling thread, which threads it starts later inherit: call it first in main. What is not
/// permitted is left as it is.
/// @return what is in force, and why it isn't what was asked for: "nice -5", "SCHED_RR 20", "nice 0 (nice -5: Operation
/// not permitted)".
std::string SetPriority(const PriorityOptions& options);

/// Puts the calling thread behind the rest of its process: for long work beside the owner thread. Ends real-time
/// scheduling for it.
/// @param steps to add to its nice level, 1 or more.
void LowerThreadPriority(int steps);

/// What is in force for the calling thread: "nice -5", "SCHED_RR 20".
std::string DescribePriority();

}  // namespace portolan
