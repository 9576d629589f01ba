#include "process/run_so_far.h"

#include <spdlog/spdlog.h>

#include <chrono>
#include <filesystem>
#include <utility>

namespace portolan {

Result<RunSoFar> RunSoFar::Open(const std::string& folder, const FrontendOptions& options) {
  RunSoFar run;
  if (folder.empty()) return Result<RunSoFar>(std::move(run));
  const std::string path = folder + "/" + kFileName;
  if (options.resume) {
    Result<std::optional<EarlierRun>> earlier = FrameJournal::Read(path);
    if (!earlier) return earlier.error();
    if (*earlier && (*earlier)->data != options.source.data) {
      return Error{path + ": is of a run on '" + (*earlier)->data + "', expected '" + options.source.data +
                   "': give another --out, or no --resume"};
    }
    if (*earlier) {
      run.earlier_ = std::move(**earlier);
      run.is_start_noted_ = run.earlier_.start.has_value();
      spdlog::info("goes on with the run of a frontend that died: {} frames were tracked", run.earlier_.frames.size());
      auto journal = FrameJournal::GoOn(path);
      if (!journal) return journal.error();
      run.journal_ = std::move(*journal);
      return Result<RunSoFar>(std::move(run));
    }
  }
  std::error_code error;
  std::filesystem::rename(path, path + ".before", error);
  if (!error)
    spdlog::warn(
        "an earlier run in this folder was not finished; its tracked frames are in {}.before (--resume goes on with "
        "such a run)",
        path);
  auto journal = FrameJournal::Begin(path, options.source.data);
  if (!journal) return journal.error();
  run.journal_ = std::move(*journal);
  return Result<RunSoFar>(std::move(run));
}

std::optional<PlaybackOptions::GoOn> RunSoFar::GoOn(uint64_t first_frame) const {
  if (!earlier_.start && earlier_.frames.empty()) return std::nullopt;
  PlaybackOptions::GoOn go_on;
  const uint64_t next = frame_offset();
  go_on.frames_played = next > first_frame ? next - first_frame : 0;
  if (const auto& start = earlier_.start) {
    const std::chrono::nanoseconds since(Timestamp::Now().ns - start->unix_time.ns);
    go_on.start = PlaybackStart{start->first_stamp, std::chrono::steady_clock::now() - since};
  }
  return go_on;
}

void RunSoFar::Note(const std::optional<PlaybackStart>& playback_start, const std::vector<FrameRecord>& frames) {
  if (has_failed_) return;
  Status written = Ok{};
  if (playback_start && !is_start_noted_) {
    const auto since = std::chrono::steady_clock::now() - playback_start->due;
    const int64_t since_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(since).count();
    written = journal_.NoteStart({playback_start->stamp, Timestamp{Timestamp::Now().ns - since_ns}});
    is_start_noted_ = true;
  }
  if (written && !frames.empty()) written = journal_.Append(frames);
  if (written) return;
  has_failed_ = true;
  spdlog::error("{}; if this process dies, its part of the trajectory goes with it", written.error().message);
}

}  // namespace portolan
