#include "transport/process_loop.h"

#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "base/check.h"

namespace portolan {

ProcessLoop::ProcessLoop(size_t capacity, size_t max_held_bytes)
    : events_(capacity, Overflow::kDropNewest), max_held_bytes_(max_held_bytes) {
  sigset_t ending;
  sigemptyset(&ending);
  sigaddset(&ending, SIGINT);
  sigaddset(&ending, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &ending, &signals_before_);
  signals_blocked_ = true;
  signal_fd_ = signalfd(-1, &ending, SFD_NONBLOCK | SFD_CLOEXEC);
  wake_fd_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  PORTOLAN_CHECK(signal_fd_ >= 0 && wake_fd_ >= 0) << std::strerror(errno);
}

ProcessLoop::~ProcessLoop() {
  RestoreSignals();
  close(signal_fd_);
  close(wake_fd_);
}

bool ProcessLoop::Post(std::function<void()> event, size_t held_bytes) {
  if (held_bytes_.fetch_add(held_bytes) + held_bytes > max_held_bytes_ && held_bytes > 0) {
    held_bytes_ -= held_bytes;
    ++too_large_;
    return false;
  }
  if (!events_.Push({std::move(event), held_bytes})) {
    held_bytes_ -= held_bytes;
    return false;
  }
  Wake();
  return true;
}

bool ProcessLoop::RunNextEvent() {
  const std::optional<Event> event = events_.TryPop();
  if (!event) return false;
  event->work();
  held_bytes_ -= event->held_bytes;
  return true;
}

void ProcessLoop::AddTimer(double period_s, std::function<void()> work) {
  PORTOLAN_CHECK(period_s > 0) << period_s;
  const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(period_s));
  timers_.push_back(Timer{period, Clock::now() + period, std::move(work)});
}

int ProcessLoop::Run() {
  const Clock::time_point start = Clock::now();
  for (Timer& timer : timers_) timer.next = start + timer.period;
  while (!stopped_) {
    Wait();
    ReadSignal();
    RunTimers();
    RunEvents();
  }
  events_.Close();
  while (RunNextEvent()) {
  }
  RestoreSignals();
  return signal_;
}

void ProcessLoop::Stop() {
  stopped_ = true;
  Wake();
}

void ProcessLoop::Wake() {
  const uint64_t one = 1;
  // Fails only when the counter is full, and then the loop is awake anyway.
  [[maybe_unused]] const ssize_t written = write(wake_fd_, &one, sizeof one);
}

/// Sleeps until an event, a signal or the next timer.
void ProcessLoop::Wait() {
  timespec timeout{};
  const timespec* until_timer = nullptr;
  if (!timers_.empty()) {
    const auto next = std::min_element(timers_.begin(), timers_.end(), [](const Timer& a, const Timer& b) {
                        return a.next < b.next;
                      })->next;
    const auto left = std::max(Clock::duration::zero(), next - Clock::now());
    const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(left);
    timeout.tv_sec = static_cast<time_t>(seconds.count());
    timeout.tv_nsec = static_cast<long>(std::chrono::duration_cast<std::chrono::nanoseconds>(left - seconds).count());
    until_timer = &timeout;
  }
  std::array<pollfd, 2> sources{pollfd{wake_fd_, POLLIN, 0}, pollfd{signal_fd_, POLLIN, 0}};
  ppoll(sources.data(), sources.size(), until_timer, nullptr);
  uint64_t wakes = 0;
  [[maybe_unused]] const ssize_t drained = read(wake_fd_, &wakes, sizeof wakes);
}

/// The events that wait now: those that they post come in the next round, so that timers get their turn.
void ProcessLoop::RunEvents() {
  for (size_t waiting = events_.size(); waiting > 0; --waiting) RunNextEvent();
  if (events_.size() > 0) Wake();
}

void ProcessLoop::RunTimers() {
  const Clock::time_point now = Clock::now();
  for (Timer& timer : timers_) {
    if (timer.next > now) continue;
    timer.work();
    timer.next += timer.period;
    if (timer.next <= now) timer.next = now + timer.period;
  }
}

void ProcessLoop::ReadSignal() {
  signalfd_siginfo info;
  if (read(signal_fd_, &info, sizeof info) != sizeof info) return;
  signal_ = static_cast<int>(info.ssi_signo);
  stopped_ = true;
}

void ProcessLoop::RestoreSignals() {
  if (!signals_blocked_) return;
  pthread_sigmask(SIG_SETMASK, &signals_before_, nullptr);
  signals_blocked_ = false;
}

}  // namespace portolan
