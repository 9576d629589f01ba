#include "process/frame_pump.h"

#include <utility>

namespace portolan {

FramePump::FramePump(Player* player, std::function<bool(PlayedFrame)> deliver, std::function<void()> at_end)
    : player_(player), deliver_(std::move(deliver)), at_end_(std::move(at_end)) {}

FramePump::~FramePump() {
  Stop();
}

void FramePump::Start() {
  if (!thread_.joinable()) thread_ = std::thread([this] { Run(); });
}

void FramePump::Done() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    busy_ = false;
  }
  changed_.notify_all();
}

void FramePump::Stop() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_all();
  player_->Stop();
  if (thread_.joinable()) thread_.join();
}

void FramePump::Run() {
  while (std::optional<PlayedFrame> frame = player_->WaitForNext()) {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      busy_ = true;
    }
    if (!deliver_(std::move(*frame))) return;
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this] { return !busy_ || stopped_; });
    if (stopped_) return;
  }
  at_end_();
}

}  // namespace portolan
