#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

namespace portolan {

/// What a full queue does with one more element. Every loss is counted.
enum class Overflow {
  kDropOldest,  ///< the oldest waiting element goes: for images and states, where the newest counts
  kDropNewest,  ///< the new element is refused: for work that the sender repeats
};

/// A queue between threads, bounded, for any number of producers and consumers. Thread-safe.
template <class T>
class BoundedQueue {
 public:
  BoundedQueue(size_t capacity, Overflow overflow) : capacity_(capacity), overflow_(overflow) {}

  /// @return false when an element was lost (the oldest or this one, by the policy) or the queue is closed.
  bool Push(T element) {
    bool lost = false;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (closed_) return false;
      if (elements_.size() >= capacity_) {
        ++dropped_;
        lost = true;
        if (overflow_ == Overflow::kDropNewest) return false;
        elements_.pop_front();
      }
      elements_.push_back(std::move(element));
    }
    changed_.notify_one();
    return !lost;
  }

  /// Waits for an element; none when the queue is closed and empty.
  std::optional<T> Pop() {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || !elements_.empty(); });
    return TakeFront();
  }

  /// Waits until `deadline` at most; none when nothing came or the queue is closed and empty.
  std::optional<T> PopUntil(std::chrono::steady_clock::time_point deadline) {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait_until(lock, deadline, [&] { return closed_ || !elements_.empty(); });
    return TakeFront();
  }

  /// An element if one is there now.
  std::optional<T> TryPop() {
    std::lock_guard<std::mutex> lock(mutex_);
    return TakeFront();
  }

  /// Refuses further elements and wakes every waiting consumer; what is queued can still be popped.
  void Close() {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      closed_ = true;
    }
    changed_.notify_all();
  }

  size_t size() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return elements_.size();
  }
  uint64_t dropped() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return dropped_;
  }
  bool closed() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return closed_;
  }

 private:
  std::optional<T> TakeFront() {
    if (elements_.empty()) return std::nullopt;
    std::optional<T> front(std::move(elements_.front()));
    elements_.pop_front();
    return front;
  }

  const size_t capacity_;
  const Overflow overflow_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<T> elements_;
  uint64_t dropped_ = 0;
  bool closed_ = false;
};

}  // namespace portolan
