#include "transport/background_work.h"

#include <malloc.h>

#include <utility>

#include "base/check.h"
#include "transport/priority.h"

namespace portolan {

BackgroundWork::BackgroundWork(ProcessLoop* loop, int nice_steps)
    : loop_(loop), thread_([this, nice_steps] { RunJobs(nice_steps); }) {}

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
    loop_->Post([this, event = std::move(event)] { OnDone(event); });
  }
}

void BackgroundWork::OnDone(const Event& event) {
  busy_ = false;
  const Event on_cancelled = std::exchange(on_cancelled_, nullptr);
  if (const Event& what = cancelled_ ? on_cancelled : event) what();
}

}  // namespace portolan
