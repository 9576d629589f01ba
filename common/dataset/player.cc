#include "dataset/player.h"

#include <spdlog/spdlog.h>

#include <utility>

#include "base/check.h"
#include "base/flat_yaml.h"

namespace portolan {

Result<PlaybackOptions> ParseSpeed(const std::string& text) {
  PlaybackOptions options;
  if (text == "max") {
    options.mode = PlaybackMode::kMax;
  } else if (text == "lockstep") {
    options.mode = PlaybackMode::kLockstep;
  } else if (!ParseNumber(text, &options.factor) || options.factor <= 0) {
    return Error{"speed '" + text + "': expected max, lockstep or a factor of real time above 0"};
  }
  return options;
}

Player::Player(std::unique_ptr<ImageSource> source, const PlaybackOptions& options)
    : source_(std::move(source)),
      options_(options),
      camera_(source_->camera()),
      live_(source_->IsLive()),
      clock_(options.factor) {
  PORTOLAN_CHECK(options.queue_capacity > 0);
  thread_ = std::thread([this] { Run(); });
}

Player::~Player() {
  Stop();
  thread_.join();
}

void Player::Stop() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopped_ = true;
  }
  source_->Cancel();
  changed_.notify_all();
}

std::optional<PlayedFrame> Player::WaitForNext() {
  Lock lock(mutex_);
  consumer_waits_ = true;
  changed_.notify_all();
  changed_.wait(lock, [&] { return stopped_ || at_end_ || !queue_.empty(); });
  if (stopped_ || queue_.empty()) return std::nullopt;
  std::optional<PlayedFrame> frame(std::move(queue_.front()));
  queue_.pop_front();
  ++report_.delivered;
  lock.unlock();
  changed_.notify_all();
  return frame;
}

PlaybackReport Player::report() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return report_;
}

std::optional<PlaybackStart> Player::start() const {
  std::lock_guard<std::mutex> lock(mutex_);
  if (!clock_.started()) return std::nullopt;
  return PlaybackStart{clock_.first_stamp(), clock_.DueAt(clock_.first_stamp())};
}

/// Where another player has been already.
void Player::PassOver() {
  if (live_ || !options_.go_on) return;
  Lock lock(mutex_);
  changed_.wait(lock, [&] { return stopped_ || consumer_waits_; });
  if (const auto& start = options_.go_on->start; Paced() && start) {
    clock_.Start(start->stamp, start->due);
    play_from_ = std::chrono::steady_clock::now();
    return;
  }
  for (; report_.passed < options_.go_on->frames_played; ++report_.passed) source_->Skip();
}

void Player::Run() {
  PassOver();
  for (bool go_on = true; go_on;) {
    if (SkipIfLate()) continue;
    Result<std::optional<Image>> image = source_->Next();
    if (!image) {
      CountUnreadable(image.error().message);
      std::lock_guard<std::mutex> lock(mutex_);
      go_on = !stopped_;
    } else if (*image) {
      go_on = Deliver(std::move(**image));
    } else {
      go_on = false;
    }
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    at_end_ = true;
  }
  changed_.notify_all();
}

/// Passes over the source's next frame if it should have been here so long ago that, decoded now, it would only push
/// others out of the queue.
bool Player::SkipIfLate() {
  const std::optional<Timestamp> stamp = source_->PeekStamp();
  if (!Paced() || !stamp) return false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (stopped_ || !clock_.started()) return false;
    const auto allowed = interval_ * static_cast<int>(options_.queue_capacity);
    const bool has_passed = HasPassed(*stamp);
    if (!has_passed && std::chrono::steady_clock::now() <= clock_.DueAt(*stamp) + allowed) return false;
    ++(has_passed ? report_.passed : report_.dropped);
    if (!has_passed) last_stamp_ = *stamp;
  }
  source_->Skip();
  return true;
}

void Player::CountUnreadable(const std::string& message) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (++report_.unreadable > PlaybackReport::kMaxMessages) return;
  report_.messages.push_back(message);
  spdlog::warn("unreadable frame: {}", message);
}

/// Queues a frame at its time. @return false when the player was stopped.
bool Player::Deliver(Image image) {
  Lock lock(mutex_);
  if (HasPassed(image.stamp)) {
    ++report_.passed;
    return !stopped_;
  }
  if (options_.mode == PlaybackMode::kRealTime) {
    if (!live_ && !WaitUntilDue(image.stamp, lock)) return false;
    if (queue_.size() >= options_.queue_capacity) {
      queue_.pop_front();
      ++report_.dropped;
    }
  } else {
    changed_.wait(lock, [&] { return stopped_ || queue_.size() < options_.queue_capacity; });
  }
  if (stopped_) return false;
  queue_.push_back({std::move(image), std::chrono::steady_clock::now()});
  lock.unlock();
  changed_.notify_all();
  return true;
}

/// @return false when the player was stopped meanwhile.
bool Player::WaitUntilDue(Timestamp stamp, Lock& lock) {
  if (!clock_.started()) {
    changed_.wait(lock, [&] { return stopped_ || consumer_waits_; });
    clock_.Start(stamp, std::chrono::steady_clock::now());
  }
  const auto due = clock_.DueAt(stamp);
  if (last_stamp_) interval_ = due - clock_.DueAt(*last_stamp_);
  last_stamp_ = stamp;
  return !changed_.wait_until(lock, due, [&] { return stopped_; });
}

}  // namespace portolan
