#include "map/map_io.h"

#include <cmath>

#include "base/hash.h"
#include "map/byte_stream.h"
#include "map/delta_check.h"

namespace portolan {
namespace {

constexpr std::string_view kKeyFrameMark = "PKFD";
constexpr std::string_view kSnapshotMark = "PMAP";
constexpr std::string_view kChangeMark = "PDLT";
constexpr int kMaxSide = 1 << 20;        // pixels: beyond any camera
constexpr int kMaxLevels = 64;           // of a pyramid: beyond any
constexpr double kUnitTolerance = 1e-6;  // of a quaternion's norm: rounding leaves 1e-15
constexpr int32_t kNoFeature = -1;       // of a removed observation (MapDelta::ObservationState)
constexpr size_t kFeatureBytes = 2 * sizeof(float) + 1 + sizeof(float) + sizeof(Descriptor);

uint64_t HashOf(std::string_view bytes) {
  Hasher hasher;
  hasher.AddBytes(bytes.data(), bytes.size());
  return hasher.Value();
}

ByteWriter Begin(std::string_view mark) {
  ByteWriter writer;
  writer.FixedArray(mark.data(), mark.size());
  writer.Fixed(kMapFormVersion);
  return writer;
}

std::string Seal(ByteWriter writer) {
  writer.Fixed(HashOf(writer.bytes()));
  return writer.Take();
}

/// The content between mark, version and hash.
Result<std::string_view> Unseal(std::string_view bytes, std::string_view mark, const std::string& what) {
  const size_t head = mark.size() + sizeof kMapFormVersion;
  if (bytes.size() < head + sizeof(uint64_t))
    return Error{what + ": cut short at " + std::to_string(bytes.size()) + " bytes"};
  if (bytes.substr(0, mark.size()) != mark) return Error{what + ": does not begin with '" + std::string(mark) + "'"};
  const auto version = ByteReader(bytes.substr(mark.size())).Fixed<uint16_t>();
  if (version != kMapFormVersion) {
    return Error{what + ": form " + std::to_string(version) + ", this program reads form " +
                 std::to_string(kMapFormVersion)};
  }
  const std::string_view hashed = bytes.substr(0, bytes.size() - sizeof(uint64_t));
  if (ByteReader(bytes.substr(hashed.size())).Fixed<uint64_t>() != HashOf(hashed))
    return Error{what + ": damaged, its hash does not match"};
  return hashed.substr(head);
}

bool IsSound(const PinholeCamera& camera) {
  const auto side = [](int pixels) { return pixels > 0 && pixels <= kMaxSide; };
  return side(camera.width) && side(camera.height) && std::isfinite(camera.fx) && camera.fx > 0 &&
         std::isfinite(camera.fy) && camera.fy > 0 && std::isfinite(camera.cx) && std::isfinite(camera.cy);
}

bool IsSound(const ScalePyramid& pyramid) {
  return pyramid.levels > 0 && pyramid.levels <= kMaxLevels && std::isfinite(pyramid.factor) && pyramid.factor > 1;
}

/// Locations on the image's area (pixels' centres are whole numbers), angles finite, octaves of the pyramid.
bool IsSound(const FeatureSet& features, const PinholeCamera& camera, const ScalePyramid& pyramid) {
  for (size_t i = 0; i < features.size(); ++i) {
    const Eigen::Vector2f& p = features.pixels_px[i];
    const bool inside = p.x() >= -0.5f && p.y() >= -0.5f && p.x() <= static_cast<float>(camera.width) - 0.5f &&
                        p.y() <= static_cast<float>(camera.height) - 0.5f;  // false for NaN
    if (!inside || !std::isfinite(features.angles_rad[i]) || features.octaves[i] >= pyramid.levels) return false;
  }
  return true;
}

bool IsSound(const Rigid3d& motion) {
  return std::abs(motion.rotation.norm() - 1) < kUnitTolerance && motion.translation.allFinite() &&
         motion.translation.cwiseAbs().maxCoeff() <= kMaxCoordinate;
}

void Write(const PinholeCamera& camera, ByteWriter* writer) {
  for (const double value : {camera.fx, camera.fy, camera.cx, camera.cy}) writer->Fixed(value);
  writer->Fixed(static_cast<int32_t>(camera.width));
  writer->Fixed(static_cast<int32_t>(camera.height));
}

PinholeCamera ReadCamera(ByteReader* reader) {
  PinholeCamera camera;
  for (double* value : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *value = reader->Fixed<double>();
  camera.width = reader->Fixed<int32_t>();
  camera.height = reader->Fixed<int32_t>();
  return camera;
}

void Write(const RadialResidual& residual, ByteWriter* writer) {
  writer->Fixed(residual.k1);
  writer->Fixed(residual.k2);
}

RadialResidual ReadResidual(ByteReader* reader) {
  RadialResidual residual;
  residual.k1 = reader->Fixed<double>();
  residual.k2 = reader->Fixed<double>();
  return residual;
}
constexpr size_t kCameraResidualBytes = 6 * sizeof(double) + 2 * sizeof(int32_t);

FeatureSet ReadFeatures(ByteReader* reader) {
  const size_t count = reader->Count(kFeatureBytes);
  FeatureSet features;
  features.pixels_px.resize(count);
  features.octaves.resize(count);
  features.angles_rad.resize(count);
  features.descriptors.resize(count);
  reader->FixedArray(features.pixels_px.data(), count);
  reader->FixedArray(features.octaves.data(), count);
  reader->FixedArray(features.angles_rad.data(), count);
  reader->FixedArray(features.descriptors.data(), count);
  return features;
}

void Write(const MapDelta::KeyFrameState& state, KeyFrameId before, ByteWriter* writer) {
  writer->Step(state.id.value, before.value);
  writer->Step(state.parent.value, state.id.value);
  writer->Fixed(state.num_features);
  writer->FixedArray(state.camera_from_map.rotation.coeffs().data(), 4);
  writer->FixedArray(state.camera_from_map.translation.data(), 3);
}
constexpr size_t kKeyFrameMinBytes = 2 + sizeof(uint32_t) + 7 * sizeof(double);

MapDelta::KeyFrameState ReadKeyFrameState(KeyFrameId before, ByteReader* reader) {
  MapDelta::KeyFrameState state;
  state.id = KeyFrameId(reader->Step(before.value));
  state.parent = KeyFrameId(reader->Step(state.id.value));
  state.num_features = reader->Fixed<uint32_t>();
  reader->FixedArray(state.camera_from_map.rotation.coeffs().data(), 4);
  reader->FixedArray(state.camera_from_map.translation.data(), 3);
  return state;
}

void WriteResiduals(const std::vector<CameraResidual>& residuals, ByteWriter* writer) {
  writer->Varint(residuals.size());
  for (const CameraResidual& known : residuals) {
    Write(known.camera, writer);
    Write(known.residual, writer);
  }
}

/// @return what is wrong with the values, empty if nothing; as the others below.
std::string ReadResiduals(ByteReader* reader, std::vector<CameraResidual>* residuals) {
  residuals->resize(reader->Count(kCameraResidualBytes));
  for (CameraResidual& known : *residuals) {
    known.camera = ReadCamera(reader);
    known.residual = ReadResidual(reader);
    if (!IsSound(known.camera) || !IsSound(known.residual)) return "a camera's residual is out of range";
  }
  return "";
}

void WriteRemovals(const MapDelta& change, ByteWriter* writer) {
  writer->Varint(change.removed_points.size());
  MapPointId point;
  for (const auto& removed : change.removed_points) {
    writer->Step(removed.id.value, point.value);
    writer->Step(removed.replaced_by.value, removed.id.value);
    point = removed.id;
  }
  writer->Varint(change.removed_keyframes.size());
  for (const auto& removed : change.removed_keyframes) {
    writer->Fixed(removed.id.value);
    writer->Fixed(removed.anchor.value);
    writer->FixedArray(removed.removed_from_anchor.rotation.coeffs().data(), 4);
    writer->FixedArray(removed.removed_from_anchor.translation.data(), 3);
  }
}

std::string ReadRemovals(ByteReader* reader, MapDelta* change) {
  change->removed_points.resize(reader->Count(2));
  MapPointId point;
  for (auto& removed : change->removed_points) {
    removed.id = MapPointId(reader->Step(point.value));
    removed.replaced_by = MapPointId(reader->Step(removed.id.value));
    point = removed.id;
    if (!point.IsValid()) return "a removed point without id";
  }
  change->removed_keyframes.resize(reader->Count(2 * sizeof(uint64_t) + 7 * sizeof(double)));
  for (auto& removed : change->removed_keyframes) {
    removed.id = KeyFrameId(reader->Fixed<uint64_t>());
    removed.anchor = KeyFrameId(reader->Fixed<uint64_t>());
    reader->FixedArray(removed.removed_from_anchor.rotation.coeffs().data(), 4);
    reader->FixedArray(removed.removed_from_anchor.translation.data(), 3);
    if (!removed.id.IsValid() || !IsSound(removed.removed_from_anchor)) return "a removed keyframe without id or pose";
  }
  return "";
}

/// @param lowest_feature 0, or -1 where observations may be removed.
void WriteLists(const MapDelta& delta, int32_t lowest_feature, ByteWriter* writer) {
  writer->Varint(delta.keyframes.size());
  KeyFrameId keyframe;
  for (const auto& state : delta.keyframes) {
    Write(state, keyframe, writer);
    keyframe = state.id;
  }
  writer->Varint(delta.points.size());
  MapPointId point;
  for (const auto& state : delta.points) {
    writer->Step(state.id.value, point.value);
    writer->FixedArray(state.position_in_map.data(), 3);
    point = state.id;
  }
  writer->Varint(delta.observations.size());
  MapDelta::ObservationState before;
  for (const auto& state : delta.observations) {
    PORTOLAN_CHECK(state.feature >= lowest_feature) << "feature " << state.feature;
    writer->Step(state.point.value, before.point.value);
    writer->Step(state.keyframe.value, before.keyframe.value);
    writer->Varint(static_cast<uint64_t>(state.feature - lowest_feature));
    before = state;
  }
}

std::string ReadLists(ByteReader* reader, int32_t lowest_feature, MapDelta* delta) {
  delta->keyframes.resize(reader->Count(kKeyFrameMinBytes));
  KeyFrameId keyframe;
  for (auto& state : delta->keyframes) {
    state = ReadKeyFrameState(keyframe, reader);
    keyframe = state.id;
    if (!keyframe.IsValid() || !IsSound(state.camera_from_map)) return "a keyframe without id or pose";
  }
  delta->points.resize(reader->Count(1 + 3 * sizeof(float)));
  MapPointId point;
  for (auto& state : delta->points) {
    state.id = MapPointId(reader->Step(point.value));
    reader->FixedArray(state.position_in_map.data(), 3);
    point = state.id;
    if (!point.IsValid() || !state.position_in_map.allFinite()) return "a point without id or position";
  }
  delta->observations.resize(reader->Count(3));
  MapDelta::ObservationState before;
  for (auto& state : delta->observations) {
    state.point = MapPointId(reader->Step(before.point.value));
    state.keyframe = KeyFrameId(reader->Step(before.keyframe.value));
    const uint64_t feature = reader->Varint();
    if (!state.point.IsValid() || !state.keyframe.IsValid() || feature > INT32_MAX)
      return "an observation out of range";
    state.feature = static_cast<int32_t>(feature) + lowest_feature;
    before = state;
  }
  return "";
}

/// What is left to be said of a delta whose values were read.
Status CheckRead(const ByteReader& reader, const std::string& wrong, const std::string& what, MapId map) {
  if (!wrong.empty()) return Error{what + " of " + ToString(map) + ": " + wrong};
  if (!reader.AtEnd()) return Error{what + " of " + ToString(map) + ": its length does not fit its content"};
  if (!map.IsValid()) return Error{what + ": without a map's id"};
  return Ok{};
}

}  // namespace

std::string EncodeKeyFrameData(const KeyFrameData& data) {
  PORTOLAN_CHECK(data.features.HasAppearance()) << "keyframe " << data.id << " is not whole";
  ByteWriter writer = Begin(kKeyFrameMark);
  writer.Fixed(data.id.value);
  writer.Fixed(data.stamp.ns);
  writer.Fixed(data.frame);
  Write(data.camera, &writer);
  writer.Fixed(static_cast<int32_t>(data.pyramid.levels));
  writer.Fixed(data.pyramid.factor);
  Write(data.residual, &writer);
  const FeatureSet& features = data.features;
  writer.Varint(features.size());
  writer.FixedArray(features.pixels_px.data(), features.size());
  writer.FixedArray(features.octaves.data(), features.size());
  writer.FixedArray(features.angles_rad.data(), features.size());
  writer.FixedArray(features.descriptors.data(), features.size());
  return Seal(std::move(writer));
}

Result<KeyFrameData> DecodeKeyFrameData(std::string_view bytes) {
  const std::string what = "keyframe data";
  const Result<std::string_view> content = Unseal(bytes, kKeyFrameMark, what);
  if (!content) return content.error();
  ByteReader reader(*content);
  KeyFrameData data;
  data.id = KeyFrameId(reader.Fixed<uint64_t>());
  data.stamp.ns = reader.Fixed<int64_t>();
  data.frame = reader.Fixed<uint64_t>();
  data.camera = ReadCamera(&reader);
  data.pyramid.levels = reader.Fixed<int32_t>();
  data.pyramid.factor = reader.Fixed<double>();
  data.residual = ReadResidual(&reader);
  data.features = ReadFeatures(&reader);
  if (!reader.AtEnd()) return Error{what + ": its length does not fit its content"};
  if (!data.id.IsValid()) return Error{what + ": without an id"};
  if (!IsSound(data.camera)) return Error{what + " " + ToString(data.id) + ": its camera is out of range"};
  if (!IsSound(data.pyramid)) return Error{what + " " + ToString(data.id) + ": its pyramid is out of range"};
  if (!IsSound(data.residual)) return Error{what + " " + ToString(data.id) + ": its camera's residual is out of range"};
  if (!IsSound(data.features, data.camera, data.pyramid))
    return Error{what + " " + ToString(data.id) + ": a feature is out of range"};
  return data;
}

std::string EncodeSnapshot(const MapDelta& snapshot) {
  PORTOLAN_CHECK(snapshot.IsSnapshot() && snapshot.removed_points.empty() && snapshot.removed_keyframes.empty())
      << "no snapshot";
  ByteWriter writer = Begin(kSnapshotMark);
  writer.Fixed(snapshot.map.value);
  writer.Fixed(snapshot.epoch);
  writer.Fixed(snapshot.revision);
  WriteResiduals(snapshot.residuals, &writer);
  WriteLists(snapshot, 0, &writer);
  return Seal(std::move(writer));
}

Result<MapDelta> DecodeSnapshot(std::string_view bytes) {
  const std::string what = "map state";
  const Result<std::string_view> content = Unseal(bytes, kSnapshotMark, what);
  if (!content) return content.error();
  ByteReader reader(*content);
  MapDelta snapshot;
  snapshot.map = MapId(reader.Fixed<uint64_t>());
  snapshot.epoch = reader.Fixed<uint64_t>();
  snapshot.revision = reader.Fixed<uint64_t>();
  std::string wrong = ReadResiduals(&reader, &snapshot.residuals);
  if (wrong.empty()) wrong = ReadLists(&reader, 0, &snapshot);
  if (Status checked = CheckRead(reader, wrong, what, snapshot.map); !checked) return checked.error();
  return snapshot;
}

std::string EncodeChange(const MapDelta& change) {
  PORTOLAN_CHECK(change.revision > change.base_revision && !change.IsSnapshot()) << "no change";
  ByteWriter writer = Begin(kChangeMark);
  writer.Fixed(change.map.value);
  writer.Fixed(change.epoch);
  writer.Fixed(change.base_revision);
  writer.Fixed(change.revision);
  WriteResiduals(change.residuals, &writer);
  WriteRemovals(change, &writer);
  WriteLists(change, kNoFeature, &writer);
  return Seal(std::move(writer));
}

Result<MapDelta> DecodeChange(std::string_view bytes) {
  const std::string what = "map change";
  const Result<std::string_view> content = Unseal(bytes, kChangeMark, what);
  if (!content) return content.error();
  ByteReader reader(*content);
  MapDelta change;
  change.map = MapId(reader.Fixed<uint64_t>());
  change.epoch = reader.Fixed<uint64_t>();
  change.base_revision = reader.Fixed<uint64_t>();
  change.revision = reader.Fixed<uint64_t>();
  std::string wrong = ReadResiduals(&reader, &change.residuals);
  if (wrong.empty()) wrong = ReadRemovals(&reader, &change);
  if (wrong.empty()) wrong = ReadLists(&reader, kNoFeature, &change);
  if (wrong.empty() && (change.IsSnapshot() || change.revision <= change.base_revision))
    wrong = "from revision " + std::to_string(change.base_revision) + " to " + std::to_string(change.revision);
  if (Status checked = CheckRead(reader, wrong, what, change.map); !checked) return checked.error();
  return change;
}

}  // namespace portolan
