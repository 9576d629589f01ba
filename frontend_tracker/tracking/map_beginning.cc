#include "tracking/map_beginning.h"

#include "base/check.h"

namespace portolan {
namespace {

constexpr size_t kMaxSince = 30;     // while the mapper makes the map; at 30 Hz a second, many times what it takes
constexpr size_t kMaxOffered = 120;  // more than the initializer waits for one pair

}  // namespace

void MapBeginning::Start(MapId map, MapId old_map) {
  map_ = map;
  old_map_ = old_map;
  queue_.clear();
  any_sent_ = false;
  initializer_.Reset();
  offered_.clear();
  DropSent();
}

void MapBeginning::Queue(Frame frame, const Eigen::Quaterniond& current_from_last, bool may_complete) {
  queue_.push_back({std::move(frame), current_from_last, may_complete});
}

std::optional<Initializer::Pair> MapBeginning::OfferQueued(int most) {
  for (int i = 0; i < most && !queue_.empty(); ++i) {
    const Queued next = std::move(queue_.front());
    queue_.pop_front();
    std::optional<Initializer::Pair> pair = Offer(next.frame, next.current_from_last);
    if (pair && next.may_complete) return pair;
  }
  return std::nullopt;
}

std::optional<Initializer::Pair> MapBeginning::Offer(const Frame& frame, const Eigen::Quaterniond& current_from_last) {
  // While a pair is with the mapper too: that keeps rotation and matches going, in case it is refused.
  std::optional<Initializer::Pair> pair = initializer_.Offer(frame, current_from_last);
  if (sent_) {
    if (since_.size() < kMaxSince) since_.push_back(frame);
    return std::nullopt;
  }
  if (initializer_.num_matches() == 0) offered_.clear();  // a new first frame
  if (offered_.size() < kMaxOffered) offered_.push_back(frame);
  return pair;
}

void MapBeginning::NoteSent(Frame first, Frame second) {
  sent_.emplace(std::move(first), std::move(second));
  any_sent_ = true;
}

void MapBeginning::DropSent() {
  sent_.reset();
  since_.clear();
}

bool MapBeginning::IsMade(const Map& map) const {
  return sent_ && map.FindKeyFrame(sent_->first.data->id) != nullptr &&
         map.FindKeyFrame(sent_->second.data->id) != nullptr;
}

MapBeginning::Frames MapBeginning::Take() {
  PORTOLAN_CHECK(sent_) << " no pair was sent";
  Frames frames{std::move(sent_->first), std::move(sent_->second), {}, std::move(since_)};
  for (Queued& queued : queue_) {
    if (frames.since.size() < kMaxSince) frames.since.push_back(std::move(queued.frame));
  }
  for (Frame& frame : offered_) {
    if (frame.number > frames.first.number && frame.number < frames.second.number) {
      frames.between.push_back(std::move(frame));
    }
  }
  Stop();
  return frames;
}

}  // namespace portolan
