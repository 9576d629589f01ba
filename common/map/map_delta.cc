#include "map/map_delta.h"

#include <algorithm>

namespace portolan {
namespace {

template <class T>
void Append(std::vector<T>* to, std::vector<T>&& from) {
  to->insert(to->end(), from.begin(), from.end());
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
  return header;
}

/// Fills chunks one after another with elements of the delta's lists.
class Splitter {
 public:
  Splitter(const MapDelta& delta, size_t max_elements) : header_(HeaderOf(delta)), room_(max_elements), max_(max_elements) {
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
  if (chunk.count == 1) return {std::move(chunk.part)};
  auto found = std::find_if(pending_.begin(), pending_.end(),
                            [&](const Pending& p) { return SameDelta(p.header, chunk.part); });
  if (found != pending_.end() && found->parts.size() != chunk.count) {
    pending_.erase(found);
    found = pending_.end();
    ++dropped_;
  }
  if (found == pending_.end()) {
    if (pending_.size() >= kMaxPending) {
      pending_.erase(pending_.begin());
      ++dropped_;
    }
    pending_.push_back(Pending{HeaderOf(chunk.part), std::vector<std::optional<MapDelta>>(chunk.count), chunk.count});
    found = std::prev(pending_.end());
  }
  if (chunk.index >= chunk.count || found->parts[chunk.index]) return {};
  found->parts[chunk.index] = std::move(chunk.part);
  if (--found->missing > 0) return {};

  MapDelta whole = found->header;
  for (std::optional<MapDelta>& part : found->parts) {
    Append(&whole.removed_points, std::move(part->removed_points));
    Append(&whole.removed_keyframes, std::move(part->removed_keyframes));
    Append(&whole.keyframes, std::move(part->keyframes));
    Append(&whole.points, std::move(part->points));
    Append(&whole.observations, std::move(part->observations));
  }
  pending_.erase(found);
  return {std::move(whole)};
}

}  // namespace portolan
