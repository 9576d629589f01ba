#include "map/keyframe.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "features/feature_quantization.h"

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
  bare.residual = data.residual;
  bare.pyramid = data.pyramid;
  bare.features.pixels_px = data.features.pixels_px;
  bare.features.octaves = data.features.octaves;
  return std::make_shared<const KeyFrameData>(std::move(bare));
}

std::shared_ptr<const KeyFrameData> WithResidual(const std::shared_ptr<const KeyFrameData>& data,
                                                 const RadialResidual& residual) {
  if (data->residual == residual) return data;
  KeyFrameData changed = *data;
  changed.residual = residual;
  CameraModel old_lens, new_lens;
  old_lens.pinhole = new_lens.pinhole = data->camera;
  old_lens.residual = data->residual;
  new_lens.residual = residual;
  std::vector<cv::Point2f> seen;
  for (const Eigen::Vector2f& pixel_px : data->features.pixels_px) {
    const Eigen::Vector2d distorted = old_lens.Distort(data->camera.Unproject(pixel_px.cast<double>()));
    seen.emplace_back(static_cast<float>(distorted.x()), static_cast<float>(distorted.y()));
  }
  const std::vector<cv::Point2f> ideal = new_lens.Undistort(seen);
  const auto right = static_cast<float>(data->camera.width - 1), bottom = static_cast<float>(data->camera.height - 1);
  for (size_t i = 0; i < ideal.size(); ++i) {
    // Beyond what the residual can say: left as it is.
    if (!std::isfinite(ideal[i].x) || !std::isfinite(ideal[i].y)) continue;
    changed.features.pixels_px[i] = {std::clamp(ideal[i].x, 0.0f, right), std::clamp(ideal[i].y, 0.0f, bottom)};
  }
  QuantizeFeatures(&changed.features, changed.camera);
  if (changed.features.HasAppearance())
    changed.grid = FeatureGrid(changed.features, changed.camera.width, changed.camera.height);
  return std::make_shared<const KeyFrameData>(std::move(changed));
}

}  // namespace portolan
