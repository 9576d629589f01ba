#include "atlas/map_shelf.h"

#include <algorithm>

namespace portolan {
namespace {

size_t AppearanceBytes(const KeyFrameData& data) {
  return data.features.size() * (sizeof(Descriptor) + sizeof(float) + sizeof(uint32_t)) +
         data.nodes.size() * sizeof(data.nodes[0]);
}

}  // namespace

MapShelf::MapShelf(const ShelfOptions& options, std::shared_ptr<const Vocabulary> vocabulary, Load load)
    : options_(options), vocabulary_(std::move(vocabulary)), load_(std::move(load)) {}

std::shared_ptr<const KeyFrameData> MapShelf::Complete(KeyFrameData data, BowVector* bow) const {
  data.grid = FeatureGrid(data.features, data.camera.width, data.camera.height);
  data.bow.clear();  // the index has it: once is enough
  data.nodes.clear();
  if (vocabulary_ != nullptr) vocabulary_->Transform(data.features.descriptors, kDirectIndexLevel, bow, &data.nodes);
  return std::make_shared<const KeyFrameData>(std::move(data));
}

void MapShelf::AddKeyFrame(MapId map, KeyFrameData data) {
  const auto replica = maps().find(map);
  if (replica != maps().end() && replica->second.FindKeyFrameData(data.id) != nullptr) return;
  BowVector bow;
  const auto complete = Complete(std::move(data), &bow);
  bags_[complete->id] = std::make_shared<const BowVector>(std::move(bow));
  replicas_.AddKeyFrameData(map, complete);
  NoteAppearance(map, *complete);
  ForgetUnusedWords();
}

void MapShelf::TakeIn(StoredMap map, bool is_stored, const std::function<void()>& note_keyframe) {
  const MapId id = map.snapshot.map;
  replicas_.AddDelta(std::move(map.snapshot));  // first: data that nothing waits for would not be kept
  for (KeyFrameData& data : map.keyframes) {
    const KeyFrameId keyframe = data.id;
    AddKeyFrame(id, std::move(data));
    if (is_stored) OnStored(keyframe);
    if (note_keyframe) note_keyframe();
  }
}

/// Frames that were offered for a map and are in none: ReplicaSet has forgotten them.
void MapShelf::ForgetUnusedWords() {
  size_t known = 0;
  for (const auto& [id, replica] : maps()) known += replica.keyframe_data().size();
  if (bags_.size() <= known + 2 * ReplicaSet::kMaxUnusedData) return;
  for (auto next = bags_.begin(); next != bags_.end();) {
    const bool is_known = std::any_of(maps().begin(), maps().end(), [&](const auto& entry) {
      return entry.second.FindKeyFrameData(next->first) != nullptr;
    });
    if (!is_known) ForgetAppearance(next->first);
    next = is_known ? std::next(next) : bags_.erase(next);
  }
}

std::vector<MapDelta> MapShelf::ApplyPending() {
  std::vector<MapDelta> applied = replicas_.ApplyPending();
  for (const MapDelta& delta : applied) Index(delta);
  return applied;
}

void MapShelf::Index(const MapDelta& delta) {
  for (const auto& removed : delta.removed_keyframes) {
    words_.Remove(removed.id, delta.map);
    const bool is_elsewhere = std::any_of(maps().begin(), maps().end(), [&](const auto& entry) {
      return entry.second.map().FindKeyFrame(removed.id) != nullptr;
    });
    if (is_elsewhere) continue;
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
    for (const auto& [other, replica] : maps()) {
      if (other != delta.map && replica.map().FindKeyFrame(state.id) != nullptr) taken_in_.emplace(delta.map, other);
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

std::vector<OtherMap> MapShelf::Others(const std::vector<MapId>& order) const {
  std::vector<OtherMap> others;
  for (const MapId id : order) {
    const Map* map = FindMap(id);
    if (map != nullptr && words_.size(id) > 0) others.push_back({map, &words_});
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

bool MapShelf::EnsureAppearance(const Map& map, const std::vector<KeyFrameId>& keyframes) {
  for (const KeyFrameId id : keyframes) {
    const KeyFrame* keyframe = map.FindKeyFrame(id);
    if (keyframe == nullptr) continue;
    if (keyframe->data->features.HasAppearance()) {
      Touch(id);
      continue;
    }
    if (!load_ || stored_.count(id) == 0) continue;
    if (loads_left_ == 0) return false;
    --loads_left_;
    ++loads_;
    Result<KeyFrameData> data = load_(id);
    if (!data) {
      ++load_failures_;
      continue;
    }
    BowVector bow;
    const auto complete = Complete(std::move(*data), &bow);
    replicas_.RestoreAppearance(map.id(), complete);
    NoteAppearance(map.id(), *complete);
  }
  return true;
}

size_t MapShelf::NumMapsWithKeyFrames() const {
  return static_cast<size_t>(std::count_if(maps().begin(), maps().end(),
                                           [](const auto& entry) { return !entry.second.map().keyframes().empty(); }));
}

bool MapShelf::IsOverBudget() const {
  if (NumMapsWithKeyFrames() <= 1 && appearances_.size() > options_.newest) return true;
  return appearance_mb() > options_.memory_mb;
}

void MapShelf::Trim() {
  for (auto next = appearances_.begin(); next != appearances_.end() && IsOverBudget();) {
    const Appearance unused = *next++;
    if (!load_ || stored_.count(unused.keyframe) == 0) continue;
    if (maps().count(unused.map) == 1) replicas_.DropAppearance(unused.map, unused.keyframe);
    ForgetAppearance(unused.keyframe);
  }
}

void MapShelf::Remove(MapId map) {
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
  for (Appearance& appearance : appearances_) {
    if (appearance.map == map) appearance.map = into;
  }
  words_.RemovePart(map);
  replicas_.Remove(map, into);
}

}  // namespace portolan
