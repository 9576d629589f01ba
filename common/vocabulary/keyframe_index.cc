#include "vocabulary/keyframe_index.h"

#include <algorithm>
#include <utility>

#include "base/check.h"

namespace portolan {

KeyFrameIndex::SlotNumber KeyFrameIndex::TakeSlot() {
  if (free_.empty()) {
    slots_.emplace_back();
    return static_cast<SlotNumber>(slots_.size() - 1);
  }
  const SlotNumber slot = free_.back();
  free_.pop_back();
  return slot;
}

void KeyFrameIndex::Add(KeyFrameId keyframe, std::shared_ptr<const BowVector> bow) {
  PORTOLAN_CHECK(bow != nullptr) << "keyframe " << keyframe;
  Remove(keyframe);
  const SlotNumber slot = TakeSlot();
  for (const auto& [word, weight] : *bow) inverted_[word].push_back({slot, weight});
  slots_[slot] = {keyframe, std::move(bow)};
  slot_of_.emplace(keyframe, slot);
}

void KeyFrameIndex::Remove(KeyFrameId keyframe) {
  const auto found = slot_of_.find(keyframe);
  if (found == slot_of_.end()) return;
  const SlotNumber slot = found->second;
  for (const auto& [word, weight] : *slots_[slot].bow) {
    const auto entry = inverted_.find(word);
    std::vector<Entry>& entries = entry->second;
    entries.erase(std::find_if(entries.begin(), entries.end(), [slot](const Entry& e) { return e.slot == slot; }));
    if (entries.empty()) inverted_.erase(entry);
  }
  slots_[slot] = Slot();
  free_.push_back(slot);
  slot_of_.erase(found);
}

std::vector<SharedWords> KeyFrameIndex::Query(const BowVector& bow) const {
  std::vector<int> words(slots_.size());
  std::vector<double> scores(slots_.size());
  for (const auto& [word, weight] : bow) {
    const auto entry = inverted_.find(word);
    if (entry == inverted_.end()) continue;
    for (const Entry& e : entry->second) {
      ++words[e.slot];
      scores[e.slot] += std::min(weight, e.weight);
    }
  }
  std::vector<SharedWords> shared;
  for (size_t slot = 0; slot < slots_.size(); ++slot) {
    if (words[slot] > 0) shared.push_back({slots_[slot].keyframe, words[slot], std::min(scores[slot], 1.0)});
  }
  std::sort(shared.begin(), shared.end(), [](const SharedWords& a, const SharedWords& b) {
    return a.words != b.words ? a.words > b.words : a.keyframe < b.keyframe;
  });
  return shared;
}

const BowVector* KeyFrameIndex::Find(KeyFrameId keyframe) const {
  const auto found = slot_of_.find(keyframe);
  return found == slot_of_.end() ? nullptr : slots_[found->second].bow.get();
}

}  // namespace portolan
