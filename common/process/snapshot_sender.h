#pragma once

#include <algorithm>
#include <deque>
#include <functional>
#include <set>
#include <vector>

#include "base/result.h"
#include "map/map.h"
#include "map/map_delta.h"
#include "map/map_replica.h"
#include "map/protocol.h"
#include "transport/bus.h"

namespace portolan {

/// Answers SnapshotRequests for a process that holds maps: the keyframe data that the askers lack, then the map's
/// state, in pieces. A piece goes when all readers have acknowledged the one before, so that a map of any size floods
/// neither the writers' history nor the readers'; what a writer refuses is tried again. Time is given in seconds of any
/// steady clock. Not thread-safe.
///
///   SnapshotSender sender(keyframe_writer, delta_writer, vocabulary_hash, find_map, load);
///   sender.Add(request);
///   if (sender.SendPiece(now_s)) loop->Post(...);  // the next piece, in the next event
///   if (!sender.IsIdle()) ...                      // at each tick
class SnapshotSender {
 public:
  /// @return null: the map is not (any more) this process's to send.
  using FindMap = std::function<const Map*(MapId)>;
  /// Of a keyframe of a map: its whole data, read from where it is stored if memory has it bare.
  using LoadData = std::function<Result<KeyFrameData>(const KeyFrameData&)>;

  SnapshotSender(Writer<KeyFrameMessage>* keyframe_writer, Writer<MapDeltaChunk>* delta_writer,
                 uint64_t vocabulary_hash, FindMap find_map, LoadData load);

  /// One that repeats itself while its map is being sent changes nothing: what is on its way to it is not in its list
  /// yet.
  void Add(const SnapshotRequest& request);

  /// Sends a piece of the map whose turn it is; blocks for kAckWaitS and what the writers do at most.
  /// @return whether to go on at once; else, unless idle, at the next tick: a writer is full.
  bool SendPiece(double now_s);
  bool IsIdle() const { return jobs_.empty(); }
  bool IsSending(MapId map) const {
    return std::any_of(jobs_.begin(), jobs_.end(), [map](const Job& job) { return job.map == map; });
  }

  uint64_t sent() const { return sent_; }      ///< whole snapshots
  uint64_t failed() const { return failed_; }  ///< given up, because data of a keyframe could not be read

  /// Keyframes of a piece, 90 kB each: within the socket buffer of a reader (4 MB).
  static constexpr size_t kKeyFramesAPiece = 24;
  /// Chunks of the state in a piece, 100 to 300 kB each; a writer may block for each, and its process is to stay alive.
  static constexpr size_t kChunksAPiece = 4;
  static constexpr double kAckWaitS = 0.005;
  /// A reader that acknowledges nothing for so long, stopped or gone without a word, holds nobody else up.
  static constexpr double kAckPatienceS = 1.0;

 private:
  struct Job {
    MapId map;
    std::set<ProcessId> askers;
    std::set<KeyFrameId> had;          ///< by all askers, or sent
    std::deque<MapDeltaChunk> chunks;  ///< of the state, once all keyframes are sent; what is left of them
    Revision revision = 0;             ///< of the state
    double since_s = -1;
    size_t keyframes = 0;  ///< sent
  };
  enum class Progress { kMore, kRefused, kDone, kFailed };

  bool IsAcknowledged(double now_s);
  Progress Continue(Job* job, const Map& map);
  Progress SendKeyFrames(Job* job, const Map& map);
  Progress SendChunks(Job* job);

  Writer<KeyFrameMessage>* keyframe_writer_;
  Writer<MapDeltaChunk>* delta_writer_;
  uint64_t vocabulary_hash_;
  FindMap find_map_;
  LoadData load_;
  std::deque<Job> jobs_;  // the first has its turn
  double last_piece_s_ = -1;
  uint64_t sent_ = 0, failed_ = 0;
};

}  // namespace portolan
