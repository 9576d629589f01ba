#pragma once

#include <functional>
#include <memory>

#include "atlas/overlap_detector.h"
#include "place_recognition/place_test_scene.h"

// What tests of overlaps share: one place seen on two passes, as two maps.

namespace portolan {

inline KeyFrameIndex IndexOf(const Map& map) {
  KeyFrameIndex index;
  for (const auto& [id, keyframe] : map.keyframes()) index.Add(id, WordsOf(keyframe.data), map.id());
  return index;
}

/// The first pass as one map, the second as another with its own frame and scale.
struct TwoMaps {
  explicit TwoMaps(const SyntheticSceneOptions& options = PlaceSceneOptions(),
                   const Appearance& second_appearance = nullptr)
      : passes(MakeTwoPasses(options, second_appearance)),
        first(BuildMap(passes.first)),
        second(MakeSecond()),
        words(IndexOf(first)) {
    first.TakeDelta();
    second.TakeDelta();
  }
  Map MakeSecond() const {
    MapBuilderOptions options;
    options.map = MapId(0, 1, 2);
    options.map_from_world = SecondFromFirst();
    return BuildMap(passes.second, options);
  }
  static Sim3d SecondFromFirst() { return Sim3d(0.6, ExpSO3({0.3, -0.6, 0.2}), {0.3, -1.2, 0.8}); }
  /// The first map, with the second taken into it by a new owner.
  Map Joined() const {
    Map joined = first;
    joined.SetEpoch(2);
    const KeyFrameId last = joined.keyframes().rbegin()->first;
    for (const auto& [id, keyframe] : second.keyframes())
      joined.AddKeyFrame(keyframe.data, keyframe.camera_from_map, keyframe.parent.IsValid() ? keyframe.parent : last);
    joined.TakeDelta();
    return joined;
  }
  KeyFrameId Second(size_t view) const { return passes.second.views[view].data->id; }
  OtherMap FirstAsOther() const { return OtherMap::Of(first, &words); }

  TwoPasses passes;
  Map first, second;
  KeyFrameIndex words;  // of the first
};

}  // namespace portolan
