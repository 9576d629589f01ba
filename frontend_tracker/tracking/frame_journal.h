#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/result.h"
#include "base/time.h"
#include "tracking/frame_history.h"

namespace portolan {

/// What a frontend that ended without a word left of its run.
struct EarlierRun {
  /// When its real-time playback began: the frame of this stamp was due then.
  struct Start {
    Timestamp first_stamp;  ///< camera's clock
    Timestamp unix_time;
  };
  std::string data;                 ///< source.data
  std::optional<Start> start;       ///< none: it was no real-time playback, or no frame came
  std::vector<FrameRecord> frames;  ///< by frame number, each as it stood last
};

/// A text file of the tracked frames, written as they come, so that a frontend that is killed leaves its part of the
/// trajectory to the one that is started in its place. A line is written at once: what was tracked is there when the
/// process dies (not when the machine does).
///
///   portolan-frames 1
///   data DATA
///   start FIRST_STAMP_NS UNIX_NS
///   frame FRAME STAMP_NS MAP ANCHOR ONLINE CAMERA_FROM_ANCHOR[7] ONLINE_CAMERA_FROM_MAP[7]      poses: tx ty tz qx qy
///   qz qw
///
/// A frame that hangs on another keyframe later is written again; a last line that is not whole counts as not written.
class FrameJournal {
 public:
  /// Of a run without output folder: writes nothing.
  FrameJournal() = default;
  ~FrameJournal();
  FrameJournal(FrameJournal&& other) noexcept { *this = std::move(other); }
  FrameJournal& operator=(FrameJournal&& other) noexcept;

  /// @return none if there is no such file. Fails naming file, line and what was expected.
  static Result<std::optional<EarlierRun>> Read(const std::string& path);
  /// A new one; what was there is replaced.
  static Result<FrameJournal> Begin(const std::string& path, const std::string& data);
  /// Behind what Read() found.
  static Result<FrameJournal> GoOn(const std::string& path);

  Status NoteStart(const EarlierRun::Start& start);
  Status Append(const std::vector<FrameRecord>& frames);
  /// The run is over, and its trajectory written.
  void Remove();

 private:
  static Result<FrameJournal> Open(const std::string& path, int flags);
  Status Write(const std::string& text);

  std::string path_;
  int file_ = -1;
};

}  // namespace portolan
