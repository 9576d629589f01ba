#include "map/keyframe.h"

#include <utility>

namespace portolan {

std::shared_ptr<const KeyFrameData> MakeKeyFrameData(KeyFrameData data, const Vocabulary* vocabulary) {
  data.grid = FeatureGrid(data.features, data.camera.width, data.camera.height);
  data.bow.clear();
  data.nodes.clear();
  if (vocabulary != nullptr) {
    vocabulary->Transform(data.features.descriptors, kDirectIndexLevel, &data.bow, &data.nodes);
  }
  return std::make_shared<const KeyFrameData>(std::move(data));
}

std::shared_ptr<const KeyFrameData> WithoutAppearance(const KeyFrameData& data) {
  KeyFrameData bare;
  bare.id = data.id;
  bare.stamp = data.stamp;
  bare.frame = data.frame;
  bare.camera = data.camera;
  bare.pyramid = data.pyramid;
  bare.features.pixels_px = data.features.pixels_px;
  bare.features.octaves = data.features.octaves;
  return std::make_shared<const KeyFrameData>(std::move(bare));
}

}  // namespace portolan
