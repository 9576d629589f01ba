#include "map_optimization/global_bundle_adjustment.h"

#include <unordered_set>
#include <utility>
#include <vector>

#include "base/time.h"
#include "map_optimization/map_correction.h"

namespace portolan {
namespace {

/// The first one leads: it is the one that BA fixes.
std::vector<KeyFrameId> AllKeyFrames(const Map& map) {
  std::vector<KeyFrameId> ids;
  for (const auto& [id, keyframe] : map.keyframes()) {
    ids.push_back(id);
    if (!keyframe.parent.IsValid()) std::swap(ids.front(), ids.back());
  }
  return ids;
}

}  // namespace

Result<MapCorrection> AdjustGlobally(const Map& map, const KeyFrameAdjustmentOptions& options,
                                     const std::atomic<bool>* stop, StageTimes* times,
                                     std::optional<LossChange>* losses) {
  const Stopwatch watch;
  const std::vector<KeyFrameId> ids = AllKeyFrames(map);
  auto adjusted = AdjustKeyFrames(map, ids, options, stop);
  if (!adjusted.ok()) return Error{"global BA: " + adjusted.error().message};
  MapCorrection correction = EmptyCorrection(map, "global_ba");
  std::unordered_set<KeyFrameId> held;
  for (const KeyFrameId id : ids) {
    const auto found = adjusted->camera_from_map.find(id);
    if (found == adjusted->camera_from_map.end()) continue;
    correction.keyframes.push_back({id, found->second});
    held.insert(id);
  }
  correction.points = std::move(adjusted->points);
  if (Status done = CompleteCorrection(map, held, options.followers, stop, &correction, losses); !done.ok()) {
    return Error{"global BA: " + done.error().message};
  }
  if (times != nullptr) times->Add("global_ba", watch.Milliseconds());
  return correction;
}

}  // namespace portolan
