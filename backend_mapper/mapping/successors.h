#pragma once

#include <cstddef>
#include <deque>
#include <unordered_map>

namespace portolan {

/// What became of ids that were replaced: follows them to the id that stands for them now. Bounded: the oldest
/// replacement is forgotten, since only messages a few seconds old still name it.
template <class IdType>
class Successors {
 public:
  void Note(IdType from, IdType into) {
    if (!next_.emplace(from, into).second) return;
    order_.push_back(from);
    if (order_.size() <= kMaxKept) return;
    next_.erase(order_.front());
    order_.pop_front();
  }

  /// All that another one noted, in its order.
  void Add(const Successors& other) {
    for (const IdType from : other.order_) Note(from, other.next_.at(from));
  }

  /// @return `id` itself if it was not replaced.
  IdType Follow(IdType id) const {
    // An id is replaced once and never comes back, so the chain ends.
    for (auto found = next_.find(id); found != next_.end(); found = next_.find(id)) id = found->second;
    return id;
  }

 private:
  static constexpr size_t kMaxKept = 20000;  // about a minute of merges at ten keyframes a second, under 2 MB
  std::unordered_map<IdType, IdType> next_;
  std::deque<IdType> order_;
};

}  // namespace portolan
