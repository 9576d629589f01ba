#include "atlas/map_shelf.h"

#include <algorithm>
#include <atomic>
#include <future>
#include <utility>

namespace portolan {
namespace {

size_t AppearanceBytes(const KeyFrameData& data) {
  return data.features.size() * (sizeof(Descriptor) + sizeof(float) + sizeof(uint32_t)) +
         data.nodes.size() * sizeof(data.nodes[0]);
}

}  // namespace

MapShelf::MapShelf(const ShelfOptions& options, std::shared_ptr<const Vocabulary> vocabulary, Load load,
                   LoadState load_state)
    : options_(options),
      vocabulary_(std::move(vocabulary)),
      load_(std::move(load)),
      load_state_(std::move(load_state)) {}

std::shared_ptr<const KeyFrameData> MapShelf::Complete(KeyFrameData data, BowVector* bow) const {
  data.grid = FeatureGrid(data.features, data.camera.width, data.camera.height);
  data.bow.clear();  // the index has it: once is enough
  data.nodes.clear();
  if (vocabulary_ != nullptr) vocabulary_->Transform(data.features.descriptors, kDirectIndexLevel, bow, &data.nodes);
  return std::make_shared<const KeyFrameData>(std::move(data));
}

bool MapShelf::HasKeyFrame(MapId map, KeyFrameId keyframe) const {
  if (const auto paged = paged_.find(map); paged != paged_.end()) return paged->second.neighbours.count(keyframe) == 1;
  const auto replica = maps().find(map);
  return replica != maps().end() && replica->second.FindKeyFrameData(keyframe) != nullptr;
}

void MapShelf::AddKeyFrame(MapId map, KeyFrameData data) {
  if (HasKeyFrame(map, data.id)) return;
  if (paged_.count(map) == 1 && BringIn(map) == nullptr) return;
  BowVector bow;
  const auto complete = Complete(std::move(data), &bow);
  Put(map, complete, std::move(bow));
}

void MapShelf::Put(MapId map, const std::shared_ptr<const KeyFrameData>& complete, BowVector bow) {
  bags_[complete->id] = std::make_shared<const BowVector>(std::move(bow));
  replicas_.AddKeyFrameData(map, complete);
  NoteAppearance(map, *complete);
  ForgetUnusedWords();
}

void MapShelf::TakeIn(StoredMap map, bool is_stored, const std::function<void()>& note_keyframe) {
  const MapId id = map.snapshot.map;
  replicas_.AddDelta(std::move(map.snapshot));  // first: data that nothing waits for would not be kept
  auto& keyframes = map.keyframes;
  const auto is_known = [&](const KeyFrameData& data) { return HasKeyFrame(id, data.id); };
  keyframes.erase(std::remove_if(keyframes.begin(), keyframes.end(), is_known), keyframes.end());
  // Words take most of the time: this thread and another find them.
  std::vector<std::shared_ptr<const KeyFrameData>> complete(keyframes.size());
  std::vector<BowVector> bags(keyframes.size());
  std::atomic<size_t> next{0};
  const auto complete_all = [&](const std::function<void()>& note) {
    for (size_t i = next++; i < keyframes.size(); i = next++) {
      complete[i] = Complete(std::move(keyframes[i]), &bags[i]);
      if (note) note();
    }
  };
  const auto other = std::async(std::launch::async, complete_all, nullptr);
  complete_all(note_keyframe);
  other.wait();
  for (size_t i = 0; i < complete.size(); ++i) {
    Put(id, complete[i], std::move(bags[i]));
    if (is_stored) OnStored(complete[i]->id);
    if (note_keyframe) note_keyframe();
  }
}

void MapShelf::AddChunk(MapDeltaChunk chunk) {
  if (ExpectState(chunk.part.map, chunk.part.epoch, chunk.part.revision)) replicas_.AddChunk(std::move(chunk));
}

void MapShelf::Announce(MapId map, Epoch epoch, Revision revision) {
  if (ExpectState(map, epoch, revision)) replicas_.Announce(map, epoch, revision);
}

/// Frames that were offered for a map and are in none: ReplicaSet has forgotten them.
void MapShelf::ForgetUnusedWords() {
  size_t known = 0;
  for (const auto& [id, replica] : maps()) known += replica.keyframe_data().size();
  for (const auto& [id, paged] : paged_) known += paged.neighbours.size();
  if (bags_.size() <= known + 2 * ReplicaSet::kMaxUnusedData) return;
  for (auto next = bags_.begin(); next != bags_.end();) {
    const auto has_it = [&](const auto& entry) { return HasKeyFrame(entry.first, next->first); };
    const bool is_known =
        std::any_of(maps().begin(), maps().end(), has_it) || std::any_of(paged_.begin(), paged_.end(), has_it);
    if (!is_known) ForgetAppearance(next->first);
    next = is_known ? std::next(next) : bags_.erase(next);
  }
}

std::vector<MapDelta> MapShelf::ApplyPending() {
  std::vector<MapDelta> applied = replicas_.ApplyPending();
  for (const MapDelta& delta : applied) {
    Index(delta);
    used_[delta.map] = ++uses_;
  }
  return applied;
}

std::vector<MapId> MapShelf::MapsWith(KeyFrameId keyframe) const {
  std::vector<MapId> with;
  for (const auto& [id, replica] : maps()) {
    if (replica.map().FindKeyFrame(keyframe) != nullptr) with.push_back(id);
  }
  for (const auto& [id, paged] : paged_) {
    if (paged.neighbours.count(keyframe) == 1) with.push_back(id);
  }
  return with;
}

void MapShelf::Index(const MapDelta& delta) {
  for (const auto& removed : delta.removed_keyframes) {
    words_.Remove(removed.id, delta.map);
    if (!MapsWith(removed.id).empty()) continue;
    bags_.erase(removed.id);
    ForgetAppearance(removed.id);
    stored_.erase(removed.id);
  }
  const Map& map = maps().at(delta.map).map();
  for (const auto& state : delta.keyframes) {
    const auto bag = bags_.find(state.id);
    if (bag == bags_.end() || words_.Find(state.id, delta.map) != nullptr || map.FindKeyFrame(state.id) == nullptr)
      continue;
    words_.Add(state.id, bag->second, delta.map);
    for (const MapId other : MapsWith(state.id)) {
      if (other != delta.map) taken_in_.emplace(delta.map, other);
    }
  }
}

const Map* MapShelf::FindMap(MapId id) const {
  const auto replica = maps().find(id);
  return replica == maps().end() || replica->second.map().revision() == 0 ? nullptr : &replica->second.map();
}

std::shared_ptr<const BowVector> MapShelf::FindWords(KeyFrameId keyframe) const {
  const auto bag = bags_.find(keyframe);
  return bag == bags_.end() ? nullptr : bag->second;
}

std::vector<OtherMap> MapShelf::Others(const std::vector<MapId>& order) {
  std::vector<OtherMap> others;
  for (const MapId id : order) {
    const auto paged = paged_.find(id);
    const bool is_there = paged == paged_.end() ? FindMap(id) != nullptr : !paged->second.is_damaged;
    if (!is_there || words_.size(id) == 0) continue;
    const auto neighbours = [this, id](KeyFrameId keyframe, size_t most) { return Neighbours(id, keyframe, most); };
    others.push_back({id, &words_, neighbours, [this, id] { return Open(id); }});
  }
  return others;
}

void MapShelf::NoteAppearance(MapId map, const KeyFrameData& data) {
  ForgetAppearance(data.id);
  appearances_.push_back({map, data.id, AppearanceBytes(data)});
  appearance_of_[data.id] = std::prev(appearances_.end());
  appearance_bytes_ += appearances_.back().bytes;
}

void MapShelf::Touch(KeyFrameId keyframe) {
  const auto found = appearance_of_.find(keyframe);
  if (found != appearance_of_.end()) appearances_.splice(appearances_.end(), appearances_, found->second);
}

void MapShelf::ForgetAppearance(KeyFrameId keyframe) {
  const auto found = appearance_of_.find(keyframe);
  if (found == appearance_of_.end()) return;
  appearance_bytes_ -= found->second->bytes;
  appearances_.erase(found->second);
  appearance_of_.erase(found);
}

void MapShelf::BeginEvent() {
  loads_left_ = options_.loads_an_event;
  map_loads_left_ = 1;
  came_short_ = false;
}

void MapShelf::BeginLookUp() {
  BeginEvent();
  ahead_ -= std::min(ahead_, options_.paged_a_lookup);
  if (ahead_ > 0) map_loads_left_ = 0;
}

bool MapShelf::EnsureAppearance(const Map& map, const std::vector<KeyFrameId>& keyframes) {
  for (const KeyFrameId id : keyframes) {
    const KeyFrame* keyframe = map.FindKeyFrame(id);
    if (keyframe == nullptr) continue;
    if (keyframe->data->features.HasAppearance()) {
      Touch(id);
      continue;
    }
    if (!load_ || stored_.count(id) == 0) continue;
    came_short_ = came_short_ || loads_left_ == 0;
    if (loads_left_ == 0) return false;
    --loads_left_;
    ++loads_;
    Result<KeyFrameData> data = load_(id);
    if (!data) {
      ++load_failures_;
      continue;
    }
    const auto complete = Complete(std::move(*data), nullptr);
    replicas_.RestoreAppearance(map.id(), complete);
    NoteAppearance(map.id(), *complete);
  }
  return true;
}

size_t MapShelf::NumMapsWithKeyFrames() const {
  return paged_.size() + static_cast<size_t>(std::count_if(maps().begin(), maps().end(), [](const auto& entry) {
           return !entry.second.map().keyframes().empty();
         }));
}

bool MapShelf::IsOverBudget() const {
  if (NumMapsWithKeyFrames() <= 1 && appearances_.size() > options_.newest) return true;
  return appearance_mb() > options_.memory_mb;
}

void MapShelf::Trim(const MayBePaged& may_be_paged) {
  if (may_be_paged && load_state_) PageMaps(may_be_paged);
  for (auto next = appearances_.begin(); next != appearances_.end() && IsOverBudget();) {
    const Appearance unused = *next++;
    if (!load_ || stored_.count(unused.keyframe) == 0) continue;
    if (maps().count(unused.map) == 1) replicas_.DropAppearance(unused.map, unused.keyframe);
    ForgetAppearance(unused.keyframe);
  }
}

void MapShelf::Remove(MapId map) {
  used_.erase(map);
  if (const auto paged = paged_.find(map); paged != paged_.end()) {
    for (const auto& [id, neighbours] : paged->second.neighbours) {
      bags_.erase(id);
      stored_.erase(id);
    }
    ForgetPaged(map);
    return replicas_.Remove(map);
  }
  const auto replica = maps().find(map);
  if (replica == maps().end()) return;
  for (const auto& [id, data] : replica->second.keyframe_data()) {
    ForgetAppearance(id);
    bags_.erase(id);
    stored_.erase(id);
  }
  words_.RemovePart(map);
  replicas_.Remove(map);
}

void MapShelf::Remove(MapId map, MapId into) {
  if (paged_.count(map) == 1 && BringIn(map) == nullptr) ForgetPaged(map);
  used_.erase(map);
  for (Appearance& appearance : appearances_) {
    if (appearance.map == map) appearance.map = into;
  }
  words_.RemovePart(map);
  replicas_.Remove(map, into);
}

}  // namespace portolan
