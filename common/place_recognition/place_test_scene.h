#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "testing/map_builder.h"
#include "vocabulary/vocabulary_training.h"

/// What tests of place recognition share: one place seen on two passes, as two maps or as one map with drift.
namespace portolan {

/// A place seen on two passes. The second looks at it from other points; its descriptors may be made to differ.
struct TwoPasses {
  SyntheticScene first, second;
  std::shared_ptr<const Vocabulary> vocabulary;
};

/// Gives the features of a view words, and what `appearance` says in place of their landmark's descriptor (may be
/// null).
using Appearance = std::function<Descriptor(int landmark, const Descriptor&)>;
inline void Finish(SyntheticView* view, const Vocabulary& vocabulary, const Appearance& appearance) {
  KeyFrameData data = *view->data;
  for (size_t i = 0; appearance && i < data.features.size(); ++i) {
    const int landmark = view->landmark_of_feature[i];
    if (landmark != kNoLandmark) data.features.descriptors[i] = appearance(landmark, data.features.descriptors[i]);
  }
  view->data = MakeKeyFrameData(std::move(data), &vocabulary);
}

/// Of a place that is found again easily: enough to see on the way along it, of which little changes its looks.
inline SyntheticSceneOptions PlaceSceneOptions() {
  SyntheticSceneOptions options;
  options.num_landmarks = 400;
  options.num_clutter = 200;
  options.num_views = 20;
  options.travel = 2;
  options.descriptor_flip_ratio = 0.03;
  return options;
}

/// @param options of the first pass. The second moves on an arc, in another session (sequences go on rising).
inline TwoPasses MakeTwoPasses(SyntheticSceneOptions options, const Appearance& second_appearance = nullptr) {
  TwoPasses passes;
  passes.first = MakeSyntheticScene(options);
  options.motion = CameraMotion::kOrbit;  // landmarks and descriptors stay: they are drawn first
  options.travel *= 0.8;
  options.session += 1;
  passes.second = MakeSyntheticScene(options);
  std::vector<std::vector<Descriptor>> images;
  for (const SyntheticView& view : passes.first.views) images.push_back(view.data->features.descriptors);
  VocabularyTrainingOptions training;
  training.branching = 6;
  training.depth = 4;  // 36 nodes in the direct index
  passes.vocabulary = TrainVocabulary(images, training, nullptr).value();
  for (SyntheticView& view : passes.first.views) Finish(&view, *passes.vocabulary, nullptr);
  for (SyntheticView& view : passes.second.views) Finish(&view, *passes.vocabulary, second_appearance);
  return passes;
}

/// query_from_candidate of two views in maps with the scales given.
inline Sim3d TrueSimilarity(const SyntheticView& query, double query_scale, const SyntheticView& candidate,
                            double candidate_scale) {
  const Rigid3d query_from_candidate = query.camera_from_world * candidate.camera_from_world.Inverse();
  return Sim3d(query_scale / candidate_scale, query_from_candidate.rotation,
               query_scale * query_from_candidate.translation);
}

/// Adds a second pass to a map as it comes when nobody has noticed the revisit: keyframes and points of its own, off by
/// the drift.
inline void AddPass(const SyntheticScene& scene, const Sim3d& map_from_world, Map* map) {
  MapBuilderOptions options;
  options.map_from_world = map_from_world;
  const Map pass = BuildMap(scene, options);
  const KeyFrameId last = map->keyframes().rbegin()->first;
  for (const auto& [id, keyframe] : pass.keyframes()) {
    map->AddKeyFrame(keyframe.data, keyframe.camera_from_map, keyframe.parent.IsValid() ? keyframe.parent : last);
  }
  for (const MapPointId id : pass.SortedPointIds()) {
    map->AddPoint(id, pass.point(id).position_in_map);
    for (const Observation& o : pass.point(id).observations) map->AddObservation(id, o.keyframe, o.feature);
  }
  map->RefreshDerived();
}

}  // namespace portolan
