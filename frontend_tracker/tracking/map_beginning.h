#pragma once

#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "map/map.h"
#include "tracking/initializer.h"

namespace portolan {

/// The beginning of a map, from the tracker's side (paper Sec. 4.1, first step): frames are offered until two of them
/// make a pair, and kept until the mapper has made the map of the pair, or refused it.
///
///   beginning.Start(map_id);
///   for each frame:
///     if (beginning.IsMade(replica)) use(beginning.Take());
///     else if (auto pair = beginning.Offer(frame, turn)) beginning.NoteSent(...);  // the two, sent as keyframes
class MapBeginning {
 public:
  explicit MapBeginning(const InitializerOptions& options) : initializer_(options) {}

  /// Begins anew. @param old_map the map that the camera was in; none at the start of a run.
  void Start(MapId map, MapId old_map = MapId());
  /// Ends without a map: none is needed any more.
  void Stop() { Start(MapId()); }
  /// The old map became part of another one.
  void SetOldMap(MapId map) { old_map_ = map; }

  /// The map that is being made; none otherwise.
  MapId map() const { return map_; }
  MapId old_map() const { return old_map_; }
  /// Whether any pair was sent since Start(): the map may come to be, whatever the tracker does.
  bool any_sent() const { return any_sent_; }
  /// The pair that the mapper has not answered yet; the frames' data have the keyframes' ids.
  const std::optional<std::pair<Frame, Frame>>& sent() const { return sent_; }

  /// Queues a frame for OfferQueued(). @param current_from_last rotation since the frame queued before. @param
  /// may_complete whether it may be the second of a pair: a map made of frames that were all tracked in the old one
  /// would not show what the camera sees now.
  void Queue(Frame frame, const Eigen::Quaterniond& current_from_last, bool may_complete);
  /// Offers queued frames, at most so many: what past frames cost is spread over the frames to come. @return the pair
  /// that is complete, to be sent.
  std::optional<Initializer::Pair> OfferQueued(int most);
  /// @param current_from_last rotation since the frame offered before.
  /// @return the pair that this frame completes, to be sent.
  std::optional<Initializer::Pair> Offer(const Frame& frame, const Eigen::Quaterniond& current_from_last);
  /// @param first, second the pair's frames as they were sent.
  void NoteSent(Frame first, Frame second);
  /// The mapper refused the pair: the same first frame goes on, with later frames against it.
  void DropSent();

  /// Whether the map has both keyframes of the pair.
  bool IsMade(const Map& map) const;

  /// What there is to track in the map, in the order of time.
  struct Frames {
    Frame first, second;
    std::vector<Frame> between;  ///< the two
    std::deque<Frame> since;     ///< while the mapper made the map
  };
  /// Ends with a map. A pair must have been sent.
  Frames Take();

 private:
  struct Queued {
    Frame frame;
    Eigen::Quaterniond current_from_last;
    bool may_complete = true;
  };

  MapId map_, old_map_;
  std::deque<Queued> queue_;
  Initializer initializer_;
  std::vector<Frame> offered_;  // since the initializer's first frame
  std::optional<std::pair<Frame, Frame>> sent_;
  bool any_sent_ = false;
  std::deque<Frame> since_;  // the pair was sent
};

}  // namespace portolan
