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

void KeyFrameIndex::FreeSlot(SlotNumber slot) {
  slots_[slot] = Slot();
  free_.push_back(slot);
}

void KeyFrameIndex::Add(KeyFrameId keyframe, std::shared_ptr<const BowVector> bow, MapId part) {
  PORTOLAN_CHECK(bow != nullptr) << "keyframe " << keyframe;
  Remove(keyframe, part);
  const auto [entry, is_new] = parts_.try_emplace(part);
  if (is_new) entry->second.number = next_part_++;
  const SlotNumber slot = TakeSlot();
  for (const auto& [word, weight] : *bow) inverted_[word].push_back({slot, weight});
  slots_[slot] = {keyframe, entry->second.number, std::move(bow)};
  entry->second.slot_of.emplace(keyframe, slot);
}

void KeyFrameIndex::Remove(KeyFrameId keyframe, MapId part) {
  const auto of_part = parts_.find(part);
  if (of_part == parts_.end()) return;
  const auto found = of_part->second.slot_of.find(keyframe);
  if (found == of_part->second.slot_of.end()) return;
  const SlotNumber slot = found->second;
  for (const auto& [word, weight] : *slots_[slot].bow) {
    const auto listed = inverted_.find(word);
    std::vector<Entry>& entries = listed->second;
    *std::find_if(entries.begin(), entries.end(), [slot](const Entry& e) { return e.slot == slot; }) = entries.back();
    entries.pop_back();
    if (entries.empty()) inverted_.erase(listed);
  }
  FreeSlot(slot);
  of_part->second.slot_of.erase(found);
}

/// In one pass over all words: keyframe by keyframe each list would be searched as often as the part has keyframes in
/// it.
void KeyFrameIndex::RemovePart(MapId part) {
  const auto of_part = parts_.find(part);
  if (of_part == parts_.end()) return;
  const auto is_of_part = [this, number = of_part->second.number](const Entry& e) {
    return slots_[e.slot].part == number;
  };
  for (auto next = inverted_.begin(); next != inverted_.end();) {
    std::vector<Entry>& entries = next->second;
    entries.erase(std::remove_if(entries.begin(), entries.end(), is_of_part), entries.end());
    next = entries.empty() ? inverted_.erase(next) : std::next(next);
  }
  for (const auto& [keyframe, slot] : of_part->second.slot_of) FreeSlot(slot);
  parts_.erase(of_part);
}

std::vector<SharedWords> KeyFrameIndex::Query(const BowVector& bow) const {
  return std::move(Query(bow, {MapId()}).front());
}

std::vector<std::vector<SharedWords>> KeyFrameIndex::Query(const BowVector& bow,
                                                           const std::vector<MapId>& parts) const {
  struct Tally {
    int words = 0;
    double score = 0;
  };
  std::vector<Tally> tallies(slots_.size());
  for (const auto& [word, weight] : bow) {
    const auto listed = inverted_.find(word);
    if (listed == inverted_.end()) continue;
    for (const Entry& e : listed->second) {
      ++tallies[e.slot].words;
      tallies[e.slot].score += std::min(weight, e.weight);
    }
  }
  std::vector<std::vector<SharedWords>> shared(parts.size());
  std::vector<std::vector<SharedWords>*> of_number(next_part_, nullptr);
  for (size_t i = 0; i < parts.size(); ++i) {
    const auto part = parts_.find(parts[i]);
    if (part != parts_.end()) of_number[part->second.number] = &shared[i];
  }
  for (size_t slot = 0; slot < slots_.size(); ++slot) {
    if (tallies[slot].words == 0) continue;  // free ones too
    std::vector<SharedWords>* of_part = of_number[slots_[slot].part];
    if (of_part != nullptr)
      of_part->push_back({slots_[slot].keyframe, tallies[slot].words, std::min(tallies[slot].score, 1.0)});
  }
  for (std::vector<SharedWords>& of_part : shared) {
    std::sort(of_part.begin(), of_part.end(), [](const SharedWords& a, const SharedWords& b) {
      return a.words != b.words ? a.words > b.words : a.keyframe < b.keyframe;
    });
  }
  return shared;
}

const BowVector* KeyFrameIndex::Find(KeyFrameId keyframe, MapId part) const {
  const auto of_part = parts_.find(part);
  if (of_part == parts_.end()) return nullptr;
  const auto found = of_part->second.slot_of.find(keyframe);
  return found == of_part->second.slot_of.end() ? nullptr : slots_[found->second].bow.get();
}

size_t KeyFrameIndex::size(MapId part) const {
  const auto found = parts_.find(part);
  return found == parts_.end() ? 0 : found->second.slot_of.size();
}

}  // namespace portolan
