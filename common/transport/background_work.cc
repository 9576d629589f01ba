#include "transport/background_work.h"

#include <malloc.h>

#include <utility>

#include "base/check.h"
#include "transport/priority.h"

namespace portolan {
namespace {

constexpr double kCollectPeriodS = 0.25;  // only where the queue was full: the process is busy for longer then

}  // namespace

BackgroundWork::BackgroundWork(ProcessLoop* loop, int nice_steps)
    : loop_(loop), thread_([this, nice_steps] { RunJobs(nice_steps); }) {
  loop_->AddTimer(kCollectPeriodS, [this] { Collect(); });
}

BackgroundWork::~BackgroundWork() {
  Cancel();
  {
    const std::lock_guard lock(mutex_);
    end_ = true;
    next_ = nullptr;
  }
  changed_.notify_one();
  thread_.join();
}

void BackgroundWork::Start(Job job, Event on_cancelled) {
  PORTOLAN_CHECK(!busy_) << "one job at a time";
  busy_ = true;
  cancelled_ = false;
  stop_ = false;
  on_cancelled_ = std::move(on_cancelled);
  {
    const std::lock_guard lock(mutex_);
    next_ = std::move(job);
  }
  changed_.notify_one();
}

void BackgroundWork::Cancel() {
  if (!busy_) return;
  cancelled_ = true;
  stop_ = true;
}

void BackgroundWork::RunJobs(int nice_steps) {
  LowerThreadPriority(nice_steps);
  for (;;) {
    Job job;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return end_ || next_ != nullptr; });
      if (end_) return;
      job = std::exchange(next_, nullptr);
    }
    Event event = job(stop_);
    job = nullptr;   // with the snapshot it holds, before the owner thread goes on
    malloc_trim(0);  // big jobs leave much of the heap empty
    {
      const std::lock_guard lock(mutex_);
      ended_ = std::move(event);
    }
    loop_->Post([this] { Collect(); });  // refused by a full queue: then the timer does
  }
}

/// Whoever comes first, the posted event or the timer, finds the job's end; the other finds nothing.
void BackgroundWork::Collect() {
  std::optional<Event> event;
  {
    const std::lock_guard lock(mutex_);
    event = std::exchange(ended_, std::nullopt);
  }
  if (!event) return;
  busy_ = false;
  const Event on_cancelled = std::exchange(on_cancelled_, nullptr);
  if (const Event& what = cancelled_ ? on_cancelled : *event) what();
}

}  // namespace portolan
