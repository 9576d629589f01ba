#pragma once

#include <optional>
#include <string>

#include "base/result.h"
#include "dataset/player.h"
#include "process/frontend_options.h"
#include "tracking/frame_journal.h"

namespace portolan {

/// The journal of a run in its output folder, and what an earlier frontend left in it: "source.resume" takes that up,
/// else it is set aside.
class RunSoFar {
 public:
  static constexpr const char* kFileName = "frames_journal.txt";

  /// @param folder empty: no journal. Fails when the file can't be read or written, is damaged, or is of other images
  /// than the options name.
  static Result<RunSoFar> Open(const std::string& folder, const FrontendOptions& options);

  /// Where a player is to go on; none: from the beginning.
  std::optional<PlaybackOptions::GoOn> GoOn(uint64_t first_frame) const;
  const std::vector<FrameRecord>& earlier_frames() const { return earlier_.frames; }
  /// Of a live source: what is to be added to its frame numbers, which begin anew.
  uint64_t frame_offset() const { return earlier_.frames.empty() ? 0 : earlier_.frames.back().frame + 1; }

  /// @param playback_start once it is known.
  void Note(const std::optional<PlaybackStart>& playback_start, const std::vector<FrameRecord>& frames);
  /// The trajectory is written.
  void Close() { journal_.Remove(); }

 private:
  EarlierRun earlier_;
  FrameJournal journal_;
  bool is_start_noted_ = false;
  bool has_failed_ = false;
};

}  // namespace portolan
