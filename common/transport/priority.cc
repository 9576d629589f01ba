#include "transport/priority.h"

#include <sched.h>
#include <sys/resource.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace portolan {
namespace {

constexpr int kFirstNice = -20;
constexpr int kLastNice = 19;
constexpr int kMaxRealtime = 99;

// On Linux, "the process 0" of these calls is the calling thread.

/// Empty on success, else the reason.
std::string SetNice(int nice) {
  return setpriority(PRIO_PROCESS, 0, nice) == 0 ? std::string() : std::string(std::strerror(errno));
}

std::string SetScheduler(int policy, int priority) {
  sched_param parameters{};
  parameters.sched_priority = priority;
  return sched_setscheduler(0, policy, &parameters) == 0 ? std::string() : std::string(std::strerror(errno));
}

}  // namespace

Status PriorityOptions::Check() const {
  if (nice < kFirstNice || nice > kLastNice)
    return Error{"priority.nice is " + std::to_string(nice) + ", -20 to 19 expected"};
  if (realtime < 0 || realtime > kMaxRealtime) {
    return Error{"priority.realtime is " + std::to_string(realtime) + ", 0 (not real-time) or 1 to 99 expected"};
  }
  return Ok{};
}

std::string SetPriority(const PriorityOptions& options) {
  std::string refused;
  const std::string nice_failure = SetNice(options.nice);
  if (options.realtime > 0) {
    const std::string failure = SetScheduler(SCHED_RR, options.realtime);
    if (failure.empty()) return DescribePriority();
    refused = "SCHED_RR " + std::to_string(options.realtime) + ": " + failure;
  }
  if (!nice_failure.empty()) {
    refused += (refused.empty() ? "nice " : ", nice ") + std::to_string(options.nice) + ": " + nice_failure;
  }
  return refused.empty() ? DescribePriority() : DescribePriority() + " (" + refused + ")";
}

void LowerThreadPriority(int steps) {
  SetScheduler(SCHED_OTHER, 0);                                        // always permitted
  SetNice(std::min(kLastNice, getpriority(PRIO_PROCESS, 0) + steps));  // so is going back
}

std::string DescribePriority() {
  const int policy = sched_getscheduler(0);
  if (policy == SCHED_RR || policy == SCHED_FIFO) {
    sched_param parameters{};
    sched_getparam(0, &parameters);
    return (policy == SCHED_RR ? "SCHED_RR " : "SCHED_FIFO ") + std::to_string(parameters.sched_priority);
  }
  return "nice " + std::to_string(getpriority(PRIO_PROCESS, 0));
}

}  // namespace portolan
