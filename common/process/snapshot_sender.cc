#include "process/snapshot_sender.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "messages/limits.h"

namespace portolan {

SnapshotSender::SnapshotSender(Writer<KeyFrameMessage>* keyframe_writer, Writer<MapDeltaChunk>* delta_writer,
                               uint64_t vocabulary_hash, FindMap find_map, LoadData load)
    : keyframe_writer_(keyframe_writer),
      delta_writer_(delta_writer),
      vocabulary_hash_(vocabulary_hash),
      find_map_(std::move(find_map)),
      load_(std::move(load)) {}

void SnapshotSender::Add(const SnapshotRequest& request) {
  const std::set<KeyFrameId> has(request.have_keyframes.begin(), request.have_keyframes.end());
  const auto job = std::find_if(jobs_.begin(), jobs_.end(), [&](const Job& j) { return j.map == request.map; });
  if (job == jobs_.end()) {
    jobs_.push_back({request.map, {request.asker}, has, {}, 0, -1, 0});
  } else if (job->askers.insert(request.asker).second) {
    std::set<KeyFrameId> both;
    std::set_intersection(job->had.begin(), job->had.end(), has.begin(), has.end(), std::inserter(both, both.end()));
    job->had = std::move(both);
    job->chunks.clear();  // it may have missed some of those that are out
  }
}

bool SnapshotSender::IsAcknowledged(double now_s) {
  if (last_piece_s_ < 0 || now_s - last_piece_s_ >= kAckPatienceS) return true;
  return keyframe_writer_->WaitForAcknowledgments(kAckWaitS) && delta_writer_->WaitForAcknowledgments(kAckWaitS);
}

bool SnapshotSender::SendPiece(double now_s) {
  if (jobs_.empty()) return false;
  if (!IsAcknowledged(now_s)) return true;
  Job job = std::move(jobs_.front());
  jobs_.pop_front();
  const Map* map = find_map_(job.map);
  if (map == nullptr) return !jobs_.empty();
  if (job.since_s < 0) job.since_s = now_s;
  last_piece_s_ = now_s;
  const Progress progress = Continue(&job, *map);
  if (progress == Progress::kDone) {
    spdlog::info("sent map {} at revision {}: {} of {} keyframes, {:.2f} s", ToString(job.map), job.revision,
                 job.keyframes, map->keyframes().size(), now_s - job.since_s);
  } else if (progress != Progress::kFailed) {
    jobs_.push_back(std::move(job));
  }
  return progress != Progress::kRefused && !jobs_.empty();
}

SnapshotSender::Progress SnapshotSender::Continue(Job* job, const Map& map) {
  if (job->chunks.empty()) {
    const Progress keyframes = SendKeyFrames(job, map);
    if (keyframes != Progress::kDone) return keyframes;
    job->revision = map.revision();
    for (MapDeltaChunk& chunk : SplitDelta(map.Snapshot(), kDeltaChunkElements))
      job->chunks.push_back(std::move(chunk));
  }
  const Progress chunks = SendChunks(job);
  if (chunks == Progress::kDone) ++sent_;
  return chunks;
}

SnapshotSender::Progress SnapshotSender::SendKeyFrames(Job* job, const Map& map) {
  size_t left = kKeyFramesAPiece;
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (job->had.count(id) == 1) continue;
    if (left-- == 0) return Progress::kMore;
    Result<KeyFrameData> data = load_(*keyframe.data);
    if (!data) {
      ++failed_;
      spdlog::error("map {} can't be sent: {}", ToString(map.id()), data.error().message);
      return Progress::kFailed;
    }
    KeyFrameMessage copy;
    copy.kind = KeyFrameKind::kCopy;
    copy.data = std::move(*data);
    copy.map = map.id();
    copy.vocabulary_hash = vocabulary_hash_;
    if (!keyframe_writer_->Write(copy)) return Progress::kRefused;
    job->had.insert(id);
    ++job->keyframes;
  }
  return Progress::kDone;
}

SnapshotSender::Progress SnapshotSender::SendChunks(Job* job) {
  for (size_t left = kChunksAPiece; !job->chunks.empty() && left > 0; --left) {
    if (!delta_writer_->Write(job->chunks.front())) return Progress::kRefused;
    job->chunks.pop_front();
  }
  return job->chunks.empty() ? Progress::kDone : Progress::kMore;
}

}  // namespace portolan
