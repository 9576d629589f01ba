#include "mapping/newest_keyframes.h"

#include <algorithm>
#include <utility>

namespace portolan {

std::vector<KeyFrameId> NewestKeyFrames(const Map& map, size_t count) {
  std::vector<std::pair<int64_t, KeyFrameId>> by_time;
  for (const auto& [id, keyframe] : map.keyframes()) by_time.emplace_back(-keyframe.data->stamp.ns, id);
  count = std::min(by_time.size(), count);
  std::partial_sort(by_time.begin(), by_time.begin() + static_cast<ptrdiff_t>(count), by_time.end());
  std::vector<KeyFrameId> newest;
  for (size_t k = 0; k < count; ++k) newest.push_back(by_time[k].second);
  return newest;
}

}  // namespace portolan
