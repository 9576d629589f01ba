#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "dataset/image_source.h"
#include "dataset/playback_clock.h"

namespace portolan {

enum class PlaybackMode {
  kRealTime,  ///< as a camera: frames come at their time, and go if nobody takes them
  kMax,       ///< as fast as the consumer takes them; nothing is dropped
  kLockstep,  ///< the same for the player; the consumer waits for the other processes between frames
};

/// When a real-time playback began: the frame of this stamp was due then.
struct PlaybackStart {
  Timestamp stamp;
  std::chrono::steady_clock::time_point due;
};

struct PlaybackOptions {
  PlaybackMode mode = PlaybackMode::kRealTime;
  double factor = 1;          ///< of real time: 0.5 is half as fast as recorded
  size_t queue_capacity = 3;  ///< decoded frames that wait: covers a hiccup of the consumer of so many frame intervals
  /// Goes on with a playback that another player began. In real time, with its start, what was due before the first
  /// WaitForNext() is passed over; else the first `frames_played` are. No effect on a live source.
  struct GoOn {
    std::optional<PlaybackStart> start;
    uint64_t frames_played = 0;
  };
  std::optional<GoOn> go_on{};
};

/// "max", "lockstep", or a positive factor of real time: the forms of `--speed`. Fails on anything else.
Result<PlaybackOptions> ParseSpeed(const std::string& text);

/// An image and when it became available to the consumer.
struct PlayedFrame {
  Image image;
  std::chrono::steady_clock::time_point available;
};

/// What became of the frames so far. Every frame of the source is counted once.
struct PlaybackReport {
  uint64_t delivered = 0;
  uint64_t dropped = 0;               ///< late: overtaken in the queue, or passed over undecoded
  uint64_t unreadable = 0;            ///< Next() of the source failed
  uint64_t passed = 0;                ///< PlaybackOptions::go_on: shown by another player, or by none
  std::vector<std::string> messages;  ///< why, of the first kMaxMessages unreadable ones
  static constexpr size_t kMaxMessages = 20;
};

/// Plays an image source as a camera would: reads and decodes ahead in a thread of its own, so that neither is in the
/// consumer's time.
///
///   Player player(std::move(*source), options);
///   while (std::optional<PlayedFrame> frame = player.WaitForNext()) Track(frame->image);
///
/// In real time the playback starts with the first call of WaitForNext(), and frame i becomes available at start +
/// (stamp i - stamp 0) / factor. A live source is not paced: its frames are available when they come. When more than
/// `queue_capacity` frames wait, the oldest goes. Frames that are so late that the queue could not hold what came after
/// them are passed over undecoded. One consumer thread; Stop() and report() from any thread.
class Player {
 public:
  Player(std::unique_ptr<ImageSource> source, const PlaybackOptions& options);
  /// Stops and waits for the thread (at most for the read of one frame).
  ~Player();
  Player(const Player&) = delete;
  Player& operator=(const Player&) = delete;

  /// Waits for the next frame; none at the end of the source or after Stop().
  std::optional<PlayedFrame> WaitForNext();
  void Stop();
  PlaybackReport report() const;
  /// When which frame was due first; none before that, or not in real time.
  std::optional<PlaybackStart> start() const;
  const CameraModel& camera() const { return camera_; }
  bool IsLive() const { return live_; }

 private:
  using Lock = std::unique_lock<std::mutex>;

  void Run();
  bool Paced() const { return options_.mode == PlaybackMode::kRealTime && !live_; }
  void PassOver();
  bool HasPassed(Timestamp stamp) const { return play_from_ && clock_.DueAt(stamp) < *play_from_; }
  bool SkipIfLate();
  void CountUnreadable(const std::string& message);
  bool Deliver(Image image);
  bool WaitUntilDue(Timestamp stamp, Lock& lock);

  const std::unique_ptr<ImageSource> source_;  ///< used by the thread only, but for Cancel()
  const PlaybackOptions options_;
  const CameraModel camera_;
  const bool live_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<PlayedFrame> queue_;
  PlaybackReport report_;
  PlaybackClock clock_;
  std::optional<std::chrono::steady_clock::time_point> play_from_;  ///< what was due before it is passed over
  std::optional<Timestamp> last_stamp_;              ///< of the last frame that was queued or passed over
  std::chrono::steady_clock::duration interval_{0};  ///< between two frames, at the playback's speed
  bool consumer_waits_ = false;                      ///< WaitForNext() was called once
  bool stopped_ = false;
  bool at_end_ = false;
  std::thread thread_;  ///< last: starts when all else is there
};

}  // namespace portolan
