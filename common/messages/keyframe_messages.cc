#include "messages/keyframe_messages.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "features/feature_quantization.h"
#include "messages/geometry_messages.h"
#include "messages/limits.h"
#include "messages/message_check.h"

namespace portolan {
namespace {

/// Bytes of a descriptor; its words are little-endian in memory and on the wire, on every machine that Portolan runs
/// on.
constexpr size_t kDescriptorBytes = sizeof(Descriptor);
static_assert(kDescriptorBytes == 32);

void FeaturesToWire(const FeatureSet& features, int steps_per_pixel, wire::KeyFrame* wire) {
  const size_t n = features.size();
  wire->x_steps().reserve(n);
  wire->y_steps().reserve(n);
  wire->angle_steps().reserve(n);
  for (size_t i = 0; i < n; ++i) {
    wire->x_steps().push_back(PixelToSteps(features.pixels_px[i].x(), steps_per_pixel));
    wire->y_steps().push_back(PixelToSteps(features.pixels_px[i].y(), steps_per_pixel));
    wire->angle_steps().push_back(AngleToSteps(features.angles_rad[i]));
  }
  wire->octaves(features.octaves);
  wire->descriptors().resize(n * kDescriptorBytes);
  if (n > 0) std::memcpy(wire->descriptors().data(), features.descriptors.data(), n * kDescriptorBytes);
}

FeatureSet FeaturesFromWire(const wire::KeyFrame& wire) {
  const size_t n = wire.x_steps().size();
  FeatureSet features;
  features.pixels_px.reserve(n);
  features.angles_rad.reserve(n);
  for (size_t i = 0; i < n; ++i) {
    features.pixels_px.emplace_back(StepsToPixel(wire.x_steps()[i], wire.steps_per_pixel()),
                                    StepsToPixel(wire.y_steps()[i], wire.steps_per_pixel()));
    features.angles_rad.push_back(StepsToAngle(wire.angle_steps()[i]));
  }
  features.octaves = wire.octaves();
  features.descriptors.resize(n);
  if (n > 0) std::memcpy(features.descriptors.data(), wire.descriptors().data(), n * kDescriptorBytes);
  return features;
}

void CheckFeatures(const wire::KeyFrame& wire, MessageCheck* check) {
  const size_t n = wire.x_steps().size();
  check->AtMost("number of features", n, kMaxFeatures);
  check->SameLength("y_steps", wire.y_steps().size(), n);
  check->SameLength("octaves", wire.octaves().size(), n);
  check->SameLength("angle_steps", wire.angle_steps().size(), n);
  check->SameLength("descriptors", wire.descriptors().size(), n * kDescriptorBytes);
  if (!check->ok()) return;
  const PinholeCamera camera = FromWire(wire.camera());
  check->Require(wire.steps_per_pixel() == StepsPerPixel(camera),
                 "steps_per_pixel is " + std::to_string(wire.steps_per_pixel()) + ", " +
                     std::to_string(StepsPerPixel(camera)) + " expected");
  const int largest_x = (camera.width - 1) * wire.steps_per_pixel();
  const int largest_y = (camera.height - 1) * wire.steps_per_pixel();
  for (size_t i = 0; check->ok() && i < n; ++i) {
    check->Require(wire.x_steps()[i] <= largest_x && wire.y_steps()[i] <= largest_y,
                   "a feature lies outside the image");
    check->Require(wire.octaves()[i] < wire.pyramid_levels(), "a feature's octave is not a level of the pyramid");
  }
}

void CheckPyramid(const wire::KeyFrame& wire, MessageCheck* check) {
  check->Require(wire.pyramid_levels() >= 1, "pyramid has no level");
  check->AtMost("pyramid_levels", wire.pyramid_levels(), kMaxPyramidLevels);
  check->Require(std::isfinite(wire.pyramid_factor()) && wire.pyramid_factor() > 1, "pyramid_factor is not above 1");
}

/// True when a value occurs twice.
bool HasRepeat(std::vector<uint16_t> values) {
  std::sort(values.begin(), values.end());
  return std::adjacent_find(values.begin(), values.end()) != values.end();
}

void CheckLandmarks(const wire::KeyFrame& wire, MessageCheck* check) {
  const size_t n = wire.x_steps().size();
  check->AtMost("number of landmarks", wire.landmarks().size(), n);
  check->SameLength("landmark_features", wire.landmark_features().size(), wire.landmarks().size());
  check->AllIds("landmarks", wire.landmarks());
  for (const uint16_t feature : wire.landmark_features())
    check->Require(feature < n, "a landmark's feature is out of range");
  check->Require(!check->ok() || !HasRepeat(wire.landmark_features()), "a feature has two landmarks");
}

void CheckMatches(const wire::KeyFrame& wire, MessageCheck* check) {
  const size_t n = wire.x_steps().size();
  check->AtMost("number of initial matches", wire.match_own_features().size(), n);
  check->SameLength("match_reference_features", wire.match_reference_features().size(),
                    wire.match_own_features().size());
  for (const uint16_t feature : wire.match_own_features())
    check->Require(feature < n, "a match's feature is out of range");
  for (const uint16_t feature : wire.match_reference_features()) {
    check->AtMost("a match's feature in the reference", feature, kMaxFeatures - 1);
  }
  check->Require(!check->ok() || !HasRepeat(wire.match_own_features()), "a feature has two matches");
}

void CheckKind(const wire::KeyFrame& wire, MessageCheck* check) {
  check->AtMost("kind", wire.kind(), static_cast<uint8_t>(KeyFrameKind::kQuery));
  const auto kind = static_cast<KeyFrameKind>(wire.kind());
  if (kind == KeyFrameKind::kTracked) check->Id("map of a tracked keyframe", wire.map_id());
  if (kind == KeyFrameKind::kInitialSecond) check->Id("reference of an initial pair's second", wire.reference());
}

}  // namespace

wire::KeyFrame ToWire(const KeyFrameMessage& message) {
  const KeyFrameData& data = message.data;
  PORTOLAN_CHECK(data.features.size() <= kMaxFeatures) << data.features.size() << " features";
  PORTOLAN_CHECK(data.features.HasAppearance()) << "keyframe " << data.id << " is not whole";
  wire::KeyFrame wire;
  wire.id(data.id.value);
  wire.stamp_ns(data.stamp.ns);
  wire.frame(data.frame);
  wire.kind(static_cast<uint8_t>(message.kind));
  wire.vocabulary_hash(message.vocabulary_hash);
  wire.map_id(message.map.value);
  wire.reference(message.reference.value);
  wire.camera_from_map(ToWire(message.camera_from_map));
  wire.camera(ToWire(data.camera));
  wire.residual(ToWire(data.residual));
  wire.pyramid_levels(static_cast<uint8_t>(data.pyramid.levels));
  wire.pyramid_factor(data.pyramid.factor);
  const int steps_per_pixel = StepsPerPixel(data.camera);
  wire.steps_per_pixel(static_cast<uint16_t>(steps_per_pixel));
  FeaturesToWire(data.features, steps_per_pixel, &wire);
  for (const auto& [feature, landmark] : message.landmarks) {
    wire.landmark_features().push_back(static_cast<uint16_t>(feature));
    wire.landmarks().push_back(landmark.value);
  }
  for (const auto& [reference_feature, own_feature] : message.initial_matches) {
    wire.match_reference_features().push_back(static_cast<uint16_t>(reference_feature));
    wire.match_own_features().push_back(static_cast<uint16_t>(own_feature));
  }
  return wire;
}

Result<KeyFrameMessage> FromWire(const wire::KeyFrame& wire) {
  MessageCheck check("KeyFrame");
  check.Id("id", wire.id());
  CheckKind(wire, &check);
  CheckRigid3("camera_from_map", wire.camera_from_map(), &check);
  CheckCamera(wire.camera(), &check);
  CheckResidual(wire.residual(), &check);
  CheckPyramid(wire, &check);
  CheckFeatures(wire, &check);
  CheckLandmarks(wire, &check);
  CheckMatches(wire, &check);
  if (!check.ok()) return check.error();

  KeyFrameMessage message;
  message.data.id = KeyFrameId(wire.id());
  message.data.stamp.ns = wire.stamp_ns();
  message.data.frame = wire.frame();
  message.data.camera = FromWire(wire.camera());
  message.data.residual = FromWire(wire.residual());
  message.data.pyramid = ScalePyramid{wire.pyramid_levels(), wire.pyramid_factor()};
  message.data.features = FeaturesFromWire(wire);
  message.kind = static_cast<KeyFrameKind>(wire.kind());
  message.vocabulary_hash = wire.vocabulary_hash();
  message.map = MapId(wire.map_id());
  message.reference = KeyFrameId(wire.reference());
  message.camera_from_map = FromWire(wire.camera_from_map());
  for (size_t i = 0; i < wire.landmarks().size(); ++i) {
    message.landmarks.emplace_back(wire.landmark_features()[i], MapPointId(wire.landmarks()[i]));
  }
  for (size_t i = 0; i < wire.match_own_features().size(); ++i) {
    message.initial_matches.emplace_back(wire.match_reference_features()[i], wire.match_own_features()[i]);
  }
  return message;
}

}  // namespace portolan
