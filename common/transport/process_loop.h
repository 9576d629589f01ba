#pragma once

#include <signal.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <vector>

#include "base/bounded_queue.h"

namespace portolan {

/// The owner thread of a process: events from other threads, timers, and the signals that end it, one after another on
/// one thread.
///
///   ProcessLoop loop(1024);                     // first in main, before any thread is started
///   auto bus = MakeBus(options);
///   auto reader = bus->CreateReader<Command>([&](Command c) { loop.Post([&process, c] { process.Handle(c); }); });
///   loop.AddTimer(1.0, [&] { status->Write(process.Status()); });
///   loop.Run();                                 // until SIGINT, SIGTERM or Stop(); what was posted before is still
///   done process.Save();
///
/// SIGINT and SIGTERM are blocked from construction to the end of Run(), in this thread and in those started meanwhile:
/// they arrive in the loop. During the work after Run() a second signal ends the process at once.
class ProcessLoop {
 public:
  /// @param capacity of the queue: an event that finds it full is refused and counted.
  /// @param max_held_bytes what the waiting events may hold together, by their senders' word; the same beyond it.
  explicit ProcessLoop(size_t capacity, size_t max_held_bytes = kMaxHeldBytes);
  ProcessLoop(const ProcessLoop&) = delete;
  ProcessLoop& operator=(const ProcessLoop&) = delete;
  ~ProcessLoop();

  /// From any thread. @param held_bytes what the event keeps in memory while it waits, where that is much: messages of
  /// the size of a keyframe. @return false when the queue is full or the loop has stopped.
  bool Post(std::function<void()> event, size_t held_bytes = 0);

  /// Calls `work` every period from the start of Run(); when the loop was busy for longer, once for all periods missed.
  /// Before Run(), or on the loop's thread from events (not from timers).
  void AddTimer(double period_s, std::function<void()> work);

  /// Runs until stopped. Once. @return the signal that ended it, 0 for Stop().
  int Run();
  /// From any thread, or from an event.
  void Stop();

  size_t depth() const { return events_.size(); }
  uint64_t dropped() const { return events_.dropped() + too_large_; }

  /// Two to three thousand keyframes: more come at once with a snapshot of a larger map alone, and are asked for again.
  static constexpr size_t kMaxHeldBytes = size_t{256} << 20;

 private:
  using Clock = std::chrono::steady_clock;
  struct Event {
    std::function<void()> work;
    size_t held_bytes = 0;
  };
  struct Timer {
    Clock::duration period;
    Clock::time_point next;
    std::function<void()> work;
  };

  void Wake();
  void Wait();
  bool RunNextEvent();
  void RunEvents();
  void RunTimers();
  void ReadSignal();
  void RestoreSignals();

  BoundedQueue<Event> events_;
  const size_t max_held_bytes_;
  std::atomic<size_t> held_bytes_{0};
  std::atomic<uint64_t> too_large_{0};  // events refused for what they hold
  std::vector<Timer> timers_;
  std::atomic<bool> stopped_{false};
  int signal_ = 0;
  int wake_fd_ = -1;
  int signal_fd_ = -1;
  bool signals_blocked_ = false;
  sigset_t signals_before_;
};

}  // namespace portolan
