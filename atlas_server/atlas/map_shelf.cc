#include "atlas/map_shelf.h"

#include <algorithm>

namespace portolan {
namespace {

size_t AppearanceBytes(const KeyFrameData& data) {
  return data.features.size() * (sizeof(Descriptor) + sizeof(float) + sizeof(uint32_t)) + data.nodes.size() * sizeof(data.nodes[0]);
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

/// Frames that were offered for a map and are in none: ReplicaSet has forgotten them.
void MapShelf::ForgetUnusedWords() {
  size_t known = 0;
  for (const auto& [id, replica] : maps()) known += replica.keyframe_data().size();
  if (bags_.size() <= known + 2 * ReplicaSet::kMaxUnusedData) return;
  for (auto next = bags_.begin(); next != bags_.end();) {
    const bool is_known = std::any_of(maps().begin(), maps().end(),
                                      [&](const auto& entry) { return entry.second.FindKeyFrameData(next->first) != nullptr; });
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
  KeyFrameIndex& words = words_[delta.map];
  for (const auto& removed : delta.removed_keyframes) {
    words.Remove(removed.id);
    const bool is_elsewhere = std::any_of(maps().begin(), maps().end(),
                                          [&](const auto& entry) { return entry.second.map().FindKeyFrame(removed.id) != nullptr; });
    if (is_elsewhere) continue;
    bags_.erase(removed.id);
    ForgetAppearance(removed.id);
    stored_.erase(removed.id);
  }
  const Map& map = maps().at(delta.map).map();
  for (const auto& state : delta.keyframes) {
    const auto bag = bags_.find(state.id);
    if (bag == bags_.end() || words.Find(state.id) != nullptr || map.FindKeyFrame(state.id) == nullptr) continue;
    words.Add(state.id, bag->second);
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
    const auto words = words_.find(id);
    if (map != nullptr && words != words_.end() && words->second.size() > 0) others.push_back({map, &words->second});
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
  return static_cast<size_t>(
      std::count_if(maps().begin(), maps().end(), [](const auto& entry) { return !entry.second.map().keyframes().empty(); }));
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
  words_.erase(map);
  replicas_.Remove(map);
}

void MapShelf::Remove(MapId map, MapId into) {
  for (Appearance& appearance : appearances_) {
    if (appearance.map == map) appearance.map = into;
  }
  words_.erase(map);
  replicas_.Remove(map, into);
}

size_t MapShelf::indexed_keyframes() const {
  size_t sum = 0;
  for (const auto& [map, words] : words_) sum += words.size();
  return sum;
}

}  // namespace portolan
