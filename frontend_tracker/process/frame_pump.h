#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

#include "dataset/player.h"

namespace portolan {

/// Takes frames from a player to the owner thread, one at a time: the next only when the owner is done with the last,
/// so that frames wait, and are dropped when they are late, in the player alone.
class FramePump {
 public:
  /// @param deliver posts a frame to the owner thread; false when it is gone. @param at_end is called once when the
  /// source has ended.
  FramePump(Player* player, std::function<bool(PlayedFrame)> deliver, std::function<void()> at_end);
  ~FramePump();

  void Start();
  /// From the owner thread: it is ready for the next frame.
  void Done();
  void Stop();

 private:
  void Run();

  Player* player_;
  std::function<bool(PlayedFrame)> deliver_;
  std::function<void()> at_end_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool busy_ = false;
  bool stopped_ = false;
  std::thread thread_;
};

}  // namespace portolan
