#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "transport/process_loop.h"

namespace portolan {

/// Long work beside a process's owner thread: one job at a time, on a thread of its own behind the rest of the process.
/// A job works on what it took with it (an immutable snapshot) and comes back as an event, which the loop runs on the
/// owner thread: soon, or, where the loop's queue was full, with the next turn of a timer.
///
///   BackgroundWork background(&loop, 4);
///   background.Start([snapshot](const std::atomic<bool>& stop) {
///     auto result = Solve(*snapshot, &stop);
///     return [this, result] { OnSolved(result); };
///   });
///
/// All functions are for the owner thread.
class BackgroundWork {
 public:
  using Event = std::function<void()>;
  using Job = std::function<Event(const std::atomic<bool>& stop)>;

  /// Before the loop runs. @param loop must outlive this object, and not run after it. @param nice_steps behind the
  /// owner thread, 1 or more.
  BackgroundWork(ProcessLoop* loop, int nice_steps);
  /// Cancels, and waits for the job to notice.
  ~BackgroundWork();
  BackgroundWork(const BackgroundWork&) = delete;
  BackgroundWork& operator=(const BackgroundWork&) = delete;

  /// Starts a job; a check fails while one is under way. @param on_cancelled runs in place of the job's event when the
  /// job ended cancelled; may be null.
  void Start(Job job, Event on_cancelled = nullptr);
  /// From Start() until one of its events is about to run.
  bool busy() const { return busy_; }
  /// Raises the job's stop flag; its event will not run. No effect without one.
  void Cancel();

 private:
  void RunJobs(int nice_steps);
  void Collect();

  ProcessLoop* loop_;
  bool busy_ = false;       // owner thread's
  bool cancelled_ = false;  // owner thread's
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::condition_variable changed_;
  Event on_cancelled_;          // owner thread's
  Job next_;                    // guarded by mutex_
  std::optional<Event> ended_;  // guarded by mutex_: of the job that has ended, until it is collected
  bool end_ = false;            // guarded by mutex_
  std::thread thread_;          // last: starts when the rest is there
};

}  // namespace portolan
