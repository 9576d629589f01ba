#include "vocabulary/keyframe_index.h"

#include <algorithm>

namespace portolan {

void KeyFrameIndex::Add(KeyFrameId keyframe, const BowVector& bow) {
  Remove(keyframe);
  for (const auto& [word, weight] : bow) inverted_[word].push_back(keyframe);
  bags_.emplace(keyframe, bow);
}

void KeyFrameIndex::Remove(KeyFrameId keyframe) {
  const auto bag = bags_.find(keyframe);
  if (bag == bags_.end()) return;
  for (const auto& [word, weight] : bag->second) {
    const auto entry = inverted_.find(word);
    std::vector<KeyFrameId>& keyframes = entry->second;
    keyframes.erase(std::find(keyframes.begin(), keyframes.end(), keyframe));
    if (keyframes.empty()) inverted_.erase(entry);
  }
  bags_.erase(bag);
}

std::vector<SharedWords> KeyFrameIndex::Query(const BowVector& bow) const {
  std::unordered_map<KeyFrameId, int> words;
  for (const auto& [word, weight] : bow) {
    const auto entry = inverted_.find(word);
    if (entry == inverted_.end()) continue;
    for (KeyFrameId keyframe : entry->second) ++words[keyframe];
  }
  std::vector<SharedWords> shared;
  shared.reserve(words.size());
  for (const auto& [keyframe, count] : words) shared.push_back({keyframe, count});
  std::sort(shared.begin(), shared.end(), [](const SharedWords& a, const SharedWords& b) {
    return a.words != b.words ? a.words > b.words : a.keyframe < b.keyframe;
  });
  return shared;
}

const BowVector* KeyFrameIndex::Find(KeyFrameId keyframe) const {
  const auto bag = bags_.find(keyframe);
  return bag == bags_.end() ? nullptr : &bag->second;
}

}  // namespace portolan
