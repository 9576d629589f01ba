#pragma once

#include <functional>
#include <memory>

#include "dataset/image_source.h"
#include "loop/loop_closer.h"
#include "mapping/known_residuals.h"
#include "mapping/local_mapper.h"
#include "tracking/tracker.h"

namespace portolan {

/// Tracker, mapper and loop closer in one thread, without DDS: what the processes do in lockstep, for tests and for
/// work on the algorithm. After each frame the mapper takes in its keyframes completely before the next one, and loops
/// found are closed. Deterministic.
class Pipeline {
 public:
  /// @param session of the ids; fixed, for runs are to be equal to the bit. Maps of two runs that meet need two.
  Pipeline(const TrackerOptions& tracker_options, const MapperOptions& mapper_options, const LoopOptions& loop_options,
           const CameraModel& camera, std::shared_ptr<const Vocabulary> vocabulary, uint32_t session = 1);

  Tracker::Output Track(const Image& image);

  Tracker& tracker() { return tracker_; }
  const Tracker& tracker() const { return tracker_; }
  /// The mappers of all maps so far, by map.
  const std::map<MapId, std::unique_ptr<LocalMapper>>& mappers() const { return mappers_; }
  const LoopCloser& loop_closer() const { return loop_closer_; }

 private:
  void Answer(const Request& request);
  void Map(const KeyFrameMessage& message);
  void RefineLens(LocalMapper* mapper);
  void CloseLoops(LocalMapper* mapper, MapperState state);

  IdMinter<MapPointId> point_ids_;
  MapperOptions mapper_options_;
  std::shared_ptr<const Vocabulary> vocabulary_;
  Tracker tracker_;
  LoopCloser loop_closer_;
  std::map<MapId, std::unique_ptr<LocalMapper>> mappers_;
  std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> firsts_;
  KnownResiduals residuals_;
  Epoch next_epoch_ = 1;
};

}  // namespace portolan
