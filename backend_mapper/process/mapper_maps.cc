// Which maps are the mapper's: grants, takeovers, fusions.

#include <algorithm>
#include <utility>

#include "process/mapper_process.h"

namespace portolan {
namespace {

// Keyframes of a map whose grant or snapshot is still on its way, 6 MB; the tracker sends them again.
constexpr size_t kMaxEarly = 64;
constexpr auto kRequestInterval = std::chrono::seconds(1);
constexpr auto kAnswerPatience = std::chrono::seconds(2);

}  // namespace

std::unique_ptr<LocalMapper> MapperProcess::MakeMapper(Map map, Epoch epoch) {
  return std::make_unique<LocalMapper>(options_, std::move(map), epoch, &point_ids_,
                                       [this](MapDelta delta) { PublishDelta(delta); });
}

void MapperProcess::Own(MapId map, Epoch epoch) {
  const auto mine = mappers_.find(map);
  if (mine != mappers_.end() && mine->second->map().epoch() >= epoch) return;
  const auto waiting = takeovers_.find(map);
  if (waiting != takeovers_.end() && waiting->second.epoch >= epoch) return;
  spdlog::info("granted map {} in epoch {}", ToString(map), epoch);
  is_standby_ = false;
  if (epoch > 1) {
    std::optional<MapReplica> warm = warm_maps_.Take(map);
    // Where the last owner drained, the two have told that they hold the same.
    const bool is_open = warm && !draining_.IsValid();
    Takeover& takeover =
        takeovers_
            .insert_or_assign(map,
                              Takeover{warm ? std::move(*warm) : MapReplica(map), epoch, {}, is_open, Clock::now()})
            .first->second;
    passed_on_.Return(&takeover.replica);
    ContinueTakeovers();
    return;
  }
  mappers_[map] = MakeMapper(Map(map, epoch), epoch);
  PublishState(true);
  TakeEarly();
}

/// Someone else owns the map from a later epoch on.
void MapperProcess::PassOn(MapId map, Epoch epoch) {
  const auto waiting = takeovers_.find(map);
  if (waiting != takeovers_.end() && waiting->second.epoch < epoch) takeovers_.erase(waiting);
  const auto mine = mappers_.find(map);
  if (mine == mappers_.end() || mine->second->map().epoch() >= epoch) return;
  spdlog::info("map {} passes on in epoch {}", ToString(map), epoch);
  passed_on_.Keep(mine->second->map());
  Drop(map);
  PublishState(keyframes_waiting_ == 0);
}

void MapperProcess::Forget(MapId map) {
  takeovers_.erase(map);
  passed_on_.Forget(map);
  early_.erase(
      std::remove_if(early_.begin(), early_.end(), [&](const KeyFrameMessage& message) { return message.map == map; }),
      early_.end());
  if (mappers_.count(map) == 0) return;
  spdlog::info("map {} is no more", ToString(map));
  Drop(map);
  PublishState(keyframes_waiting_ == 0);
}

void MapperProcess::Drop(MapId map) {
  const auto mapper = mappers_.find(map);
  KeepTimes(*mapper->second, &process_times_);
  mappers_.erase(mapper);
  if (state_.map != map) return;
  const Map* other = mappers_.empty() ? nullptr : &mappers_.rbegin()->second->map();
  state_.map = other != nullptr ? other->id() : MapId();
  state_.epoch = other != nullptr ? other->epoch() : 0;
  state_.revision = other != nullptr ? other->revision() : 0;
}

void MapperProcess::KeepTimes(const LocalMapper& mapper, StageTimes* times) {
  for (const auto& [stage, samples] : mapper.stage_times().samples()) {
    for (const double sample : samples) times->Add(stage, sample);
  }
}

/// A keyframe of a map that is not here. Of other robots' maps it is not for this mapper, unless one is just coming
/// here.
void MapperProcess::WaitForGrant(KeyFrameMessage message) {
  if (message.map.robot() != setup_.options.robot && takeovers_.count(message.map) == 0) return;
  if (early_.size() >= kMaxEarly) {
    early_.erase(early_.begin());
    ++early_dropped_;
  }
  early_.push_back(std::move(message));
}

void MapperProcess::TakeEarly() {
  std::vector<KeyFrameMessage> early;
  early.swap(early_);
  for (KeyFrameMessage& message : early) OnKeyFrame(std::move(message));
}

void MapperProcess::ContinueTakeovers() {
  bool any = false;
  for (auto next = takeovers_.begin(); next != takeovers_.end();) {
    const bool done = ContinueTakeover(&next->second);
    next = done ? takeovers_.erase(next) : std::next(next);
    any = any || done;
  }
  if (any) TakeEarly();
}

bool MapperProcess::ContinueTakeover(Takeover* takeover) {
  takeover->replica.ApplyPending();
  const Map& map = takeover->replica.map();
  // Any snapshot of an older epoch will do, an empty one too: then the last owner died before the map began.
  const bool is_open = takeover->is_open && Clock::now() - takeover->since < kAnswerPatience;
  if (map.epoch() > 0 && !is_open && !takeover->replica.NeedsSnapshot()) {
    spdlog::info("goes on with map {} at revision {}: {} keyframes, {} points", ToString(map.id()), map.revision(),
                 map.keyframes().size(), map.points().size());
    auto& mapper = mappers_[map.id()];
    mapper = MakeMapper(map, takeover->epoch);
    residuals_.Learn(map);
    mapper->PublishSnapshot();  // a new epoch begins with one: replicas may be ahead of it or behind
    state_.map = map.id();
    state_.epoch = takeover->epoch;
    state_.revision = mapper->map().revision();
    PublishState(keyframes_waiting_ == 0);
    if (draining_.IsValid()) TellHeld(MeasureMap(mapper->map()));
    return true;
  }
  if (Clock::now() - takeover->last_request < kRequestInterval) return false;
  takeover->last_request = Clock::now();
  snapshot_writer_->Write(takeover->replica.MakeRequest(setup_.process));
  return false;
}

void MapperProcess::OnDeltaChunk(const MapDeltaChunk& chunk) {
  if (is_standby_) {
    warm_maps_.AddChunk(chunk);
    FollowOwner();
  }
  const auto takeover = takeovers_.find(chunk.part.map);
  if (takeover == takeovers_.end()) return;
  for (MapDelta& delta : assembler_.Add(chunk)) {
    if (delta.IsSnapshot()) takeover->second.is_open = false;  // whichever is newer counts
    takeover->second.replica.AddDelta(std::move(delta));
  }
  ContinueTakeovers();
}

void MapperProcess::OnCopy(const KeyFrameMessage& copy) {
  if (is_standby_) warm_maps_.AddKeyFrame(copy.map, copy.data);
  const auto takeover = takeovers_.find(copy.map);
  if (takeover == takeovers_.end()) return;
  takeover->second.replica.AddKeyFrameData(MakeKeyFrameData(copy.data, nullptr));
  ContinueTakeovers();
}

Status MapperProcess::Fuse(const MapCorrection& fusion) {
  const auto other = mappers_.find(fusion.other);
  if (other == mappers_.end()) return Error{"map " + ToString(fusion.other) + " is not this mapper's to be fused"};
  const size_t keyframes = other->second->map().keyframes().size();
  if (Status taken = mappers_.at(fusion.map)->TakeIn(*other->second, fusion); !taken) return taken;
  fused_.Note(other->second->map(), fusion.map, fusion.map_from_other);
  ++fusions_;
  spdlog::info("map {} with {} keyframes is part of map {} now: {} landmarks merged, scale {:.3f}",
               ToString(fusion.other), keyframes, ToString(fusion.map), fusion.merges.size(),
               fusion.map_from_other.scale);
  Drop(fusion.other);
  return Ok{};
}

}  // namespace portolan
