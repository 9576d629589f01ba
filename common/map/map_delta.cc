#include "map/map_delta.h"

#include <algorithm>

namespace portolan {
namespace {

template <class T>
void Append(std::vector<T>* to, const std::vector<T>& from) {
  to->insert(to->end(), from.begin(), from.end());
}

template <class T>
size_t BytesOf(const std::vector<T>& list) {
  return list.capacity() * sizeof(T);
}

/// What a part takes while it waits, with its place among the parts.
size_t HeldBytes(const MapDelta& part) {
  return sizeof(std::map<uint32_t, MapDelta>::value_type) + BytesOf(part.removed_points) +
         BytesOf(part.removed_keyframes) + BytesOf(part.keyframes) + BytesOf(part.points) + BytesOf(part.observations);
}

bool SameDelta(const MapDelta& a, const MapDelta& b) {
  return a.map == b.map && a.epoch == b.epoch && a.base_revision == b.base_revision && a.revision == b.revision;
}

MapDelta HeaderOf(const MapDelta& delta) {
  MapDelta header;
  header.map = delta.map;
  header.epoch = delta.epoch;
  header.base_revision = delta.base_revision;
  header.revision = delta.revision;
  header.residuals = delta.residuals;
  return header;
}

MapDelta Join(MapDelta header, std::map<uint32_t, MapDelta> parts) {
  MapDelta whole = std::move(header);
  for (const auto& [index, part] : parts) {
    Append(&whole.removed_points, part.removed_points);
    Append(&whole.removed_keyframes, part.removed_keyframes);
    Append(&whole.keyframes, part.keyframes);
    Append(&whole.points, part.points);
    Append(&whole.observations, part.observations);
  }
  return whole;
}

/// Fills chunks one after another with elements of the delta's lists.
class Splitter {
 public:
  Splitter(const MapDelta& delta, size_t max_elements)
      : header_(HeaderOf(delta)), room_(max_elements), max_(max_elements) {
    chunks_.emplace_back().part = header_;
  }

  template <class T>
  void Add(const std::vector<T>& elements, std::vector<T> MapDelta::*list) {
    for (size_t begin = 0; begin < elements.size();) {
      if (room_ == 0) {
        chunks_.emplace_back().part = header_;
        room_ = max_;
      }
      const size_t count = std::min(room_, elements.size() - begin);
      auto& to = chunks_.back().part.*list;
      to.insert(to.end(), elements.begin() + static_cast<ptrdiff_t>(begin),
                elements.begin() + static_cast<ptrdiff_t>(begin + count));
      begin += count;
      room_ -= count;
    }
  }

  std::vector<MapDeltaChunk> Take() {
    for (size_t i = 0; i < chunks_.size(); ++i) {
      chunks_[i].index = static_cast<uint32_t>(i);
      chunks_[i].count = static_cast<uint32_t>(chunks_.size());
    }
    return std::move(chunks_);
  }

 private:
  MapDelta header_;
  size_t room_, max_;
  std::vector<MapDeltaChunk> chunks_;
};

}  // namespace

std::vector<MapDeltaChunk> SplitDelta(const MapDelta& delta, size_t max_elements) {
  Splitter splitter(delta, std::max<size_t>(max_elements, 1));
  splitter.Add(delta.removed_points, &MapDelta::removed_points);
  splitter.Add(delta.removed_keyframes, &MapDelta::removed_keyframes);
  splitter.Add(delta.keyframes, &MapDelta::keyframes);
  splitter.Add(delta.points, &MapDelta::points);
  splitter.Add(delta.observations, &MapDelta::observations);
  return splitter.Take();
}

std::vector<MapDelta> DeltaAssembler::Add(MapDeltaChunk chunk) {
  if (chunk.index >= chunk.count) return {};
  if (chunk.count == 1) return {std::move(chunk.part)};
  Pending& pending = PendingOf(chunk);
  const auto [part, is_new] = pending.parts.try_emplace(chunk.index, std::move(chunk.part));
  if (!is_new) return {};
  if (pending.parts.size() == pending.count) {
    MapDelta whole = Join(std::move(pending.header), std::move(pending.parts));
    pending_.erase(pending_.begin() + (&pending - pending_.data()));
    return {std::move(whole)};
  }
  pending.bytes += HeldBytes(part->second);
  MakeRoom();
  return {};
}

size_t DeltaAssembler::pending_bytes() const {
  size_t sum = 0;
  for (const Pending& pending : pending_) sum += pending.bytes;
  return sum;
}

DeltaAssembler::Pending& DeltaAssembler::PendingOf(const MapDeltaChunk& chunk) {
  const auto found =
      std::find_if(pending_.begin(), pending_.end(), [&](const Pending& p) { return SameDelta(p.header, chunk.part); });
  if (found != pending_.end()) {
    if (found->count == chunk.count) return *found;
    Drop(found);
  }
  if (pending_.size() >= kMaxPending) Drop(pending_.begin());
  pending_.emplace_back();
  pending_.back().header = HeaderOf(chunk.part);
  pending_.back().count = chunk.count;
  return pending_.back();
}

void DeltaAssembler::MakeRoom() {
  while (pending_bytes() > max_pending_bytes_) {
    Drop(std::max_element(pending_.begin(), pending_.end(),
                          [](const Pending& a, const Pending& b) { return a.bytes < b.bytes; }));
  }
}

void DeltaAssembler::Drop(std::vector<Pending>::iterator pending) {
  pending_.erase(pending);
  ++dropped_;
}

}  // namespace portolan
