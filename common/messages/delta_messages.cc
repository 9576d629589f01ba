#include "messages/delta_messages.h"

#include <string>
#include <unordered_map>

#include "messages/geometry_messages.h"
#include "messages/limits.h"
#include "messages/message_check.h"

namespace portolan {
namespace {

constexpr uint16_t kNotSeen = 65535;  ///< on the wire for feature -1
constexpr uint16_t kLongestRun = 65535;

void RemovalsToWire(const MapDelta& delta, wire::MapDelta* wire) {
  for (const MapDelta::RemovedPoint& removed : delta.removed_points) {
    wire->removed_points().push_back(removed.id.value);
    wire->removed_replaced_by().push_back(removed.replaced_by.value);
  }
  for (const MapDelta::RemovedKeyFrame& removed : delta.removed_keyframes) {
    wire->removed_keyframes().push_back(removed.id.value);
    wire->removed_anchors().push_back(removed.anchor.value);
    AppendRigid3(removed.removed_from_anchor, &wire->removed_from_anchor());
  }
}

void ObservationsToWire(const MapDelta& delta, wire::MapDelta* wire) {
  std::unordered_map<KeyFrameId, uint16_t> table;  // looked up, never iterated
  for (const MapDelta::ObservationState& observation : delta.observations) {
    const auto [entry, is_new] = table.emplace(observation.keyframe, static_cast<uint16_t>(table.size()));
    if (is_new) wire->observing_keyframes().push_back(observation.keyframe.value);
    wire->observation_keyframes().push_back(entry->second);
    wire->observation_features().push_back(observation.feature < 0 ? kNotSeen
                                                                   : static_cast<uint16_t>(observation.feature));
    const bool continues = !wire->run_points().empty() && wire->run_points().back() == observation.point.value &&
                           wire->run_lengths().back() < kLongestRun;
    if (continues) {
      ++wire->run_lengths().back();
    } else {
      wire->run_points().push_back(observation.point.value);
      wire->run_lengths().push_back(1);
    }
  }
}

void CheckHeader(const wire::MapDelta& wire, MessageCheck* check) {
  check->Id("map", wire.map_id());
  check->AtMost("epoch", wire.epoch(), kMaxEpoch);
  check->AtMost("revision", wire.revision(), kMaxRevision);
  check->AtMost("chunk_count", wire.chunk_count(), kMaxChunks);
  check->Require(wire.chunk_index() < wire.chunk_count(),
                 "chunk " + std::to_string(wire.chunk_index()) + " of " + std::to_string(wire.chunk_count()));
  check->Require(wire.base_revision() == 0 || wire.revision() > wire.base_revision(),
                 "revision " + std::to_string(wire.revision()) + " does not follow its base " +
                     std::to_string(wire.base_revision()));
}

void CheckRemovals(const wire::MapDelta& wire, MessageCheck* check) {
  check->SameLength("removed_replaced_by", wire.removed_replaced_by().size(), wire.removed_points().size());
  check->AllIds("removed_points", wire.removed_points());
  const size_t n = wire.removed_keyframes().size();
  check->SameLength("removed_anchors", wire.removed_anchors().size(), n);
  check->SameLength("removed_from_anchor", wire.removed_from_anchor().size(), n * kRigid3Doubles);
  check->AllIds("removed_keyframes", wire.removed_keyframes());
  CheckPoseArray("removed_from_anchor", wire.removed_from_anchor(), false, check);
}

void CheckElements(const wire::MapDelta& wire, MessageCheck* check) {
  const size_t n = wire.keyframes().size();
  check->SameLength("keyframe_parents", wire.keyframe_parents().size(), n);
  check->SameLength("keyframe_num_features", wire.keyframe_num_features().size(), n);
  check->SameLength("keyframe_poses", wire.keyframe_poses().size(), n * kRigid3Doubles);
  check->AllIds("keyframes", wire.keyframes());
  CheckPoseArray("keyframe_poses", wire.keyframe_poses(), false, check);
  for (const uint32_t features : wire.keyframe_num_features())
    check->AtMost("keyframe_num_features", features, kMaxFeatures);
  check->SameLength("point_positions", wire.point_positions().size(), wire.points().size() * 3);
  check->AllIds("points", wire.points());
  check->AllFinite("point_positions", wire.point_positions());
}

void CheckObservations(const wire::MapDelta& wire, MessageCheck* check) {
  const size_t n = wire.observation_features().size();
  check->SameLength("observation_keyframes", wire.observation_keyframes().size(), n);
  check->SameLength("run_lengths", wire.run_lengths().size(), wire.run_points().size());
  size_t sum = 0;
  for (const uint16_t length : wire.run_lengths()) {
    check->Require(length > 0, "a run of observations is empty");
    sum += length;
  }
  check->SameLength("observations in runs", sum, n);
  check->AtMost("number of observing keyframes", wire.observing_keyframes().size(), n);
  check->AllIds("run_points", wire.run_points());
  check->AllIds("observing_keyframes", wire.observing_keyframes());
  for (const uint16_t index : wire.observation_keyframes()) {
    check->Require(index < wire.observing_keyframes().size(), "an observation's keyframe is not in the table");
  }
  for (const uint16_t feature : wire.observation_features()) {
    check->Require(feature < kMaxFeatures || feature == kNotSeen, "an observation's feature is out of range");
  }
}

void RemovalsFromWire(const wire::MapDelta& wire, MapDelta* delta) {
  for (size_t i = 0; i < wire.removed_points().size(); ++i) {
    delta->removed_points.push_back({MapPointId(wire.removed_points()[i]), MapPointId(wire.removed_replaced_by()[i])});
  }
  for (size_t i = 0; i < wire.removed_keyframes().size(); ++i) {
    delta->removed_keyframes.push_back({KeyFrameId(wire.removed_keyframes()[i]), KeyFrameId(wire.removed_anchors()[i]),
                                        Rigid3FromArray(&wire.removed_from_anchor()[i * kRigid3Doubles])});
  }
}

void ElementsFromWire(const wire::MapDelta& wire, MapDelta* delta) {
  for (size_t i = 0; i < wire.keyframes().size(); ++i) {
    delta->keyframes.push_back({KeyFrameId(wire.keyframes()[i]),
                                Rigid3FromArray(&wire.keyframe_poses()[i * kRigid3Doubles]),
                                KeyFrameId(wire.keyframe_parents()[i]), wire.keyframe_num_features()[i]});
  }
  for (size_t i = 0; i < wire.points().size(); ++i) {
    delta->points.push_back(
        {MapPointId(wire.points()[i]), Eigen::Map<const Eigen::Vector3f>(&wire.point_positions()[3 * i])});
  }
  delta->observations.reserve(wire.observation_features().size());
  size_t next = 0;
  for (size_t run = 0; run < wire.run_points().size(); ++run) {
    for (uint16_t k = 0; k < wire.run_lengths()[run]; ++k, ++next) {
      const uint16_t feature = wire.observation_features()[next];
      delta->observations.push_back({MapPointId(wire.run_points()[run]),
                                     KeyFrameId(wire.observing_keyframes()[wire.observation_keyframes()[next]]),
                                     feature == kNotSeen ? -1 : int32_t{feature}});
    }
  }
}

}  // namespace

wire::MapDelta ToWire(const MapDeltaChunk& chunk) {
  const MapDelta& delta = chunk.part;
  PORTOLAN_CHECK(delta.observations.size() <= kMaxChunkElements)
      << delta.observations.size() << " observations in a chunk";
  wire::MapDelta wire;
  wire.map_id(delta.map.value);
  wire.epoch(delta.epoch);
  wire.base_revision(delta.base_revision);
  wire.revision(delta.revision);
  wire.chunk_index(chunk.index);
  wire.chunk_count(chunk.count);
  for (const CameraResidual& known : delta.residuals) wire.residuals().push_back(ToWire(known));
  RemovalsToWire(delta, &wire);
  for (const MapDelta::KeyFrameState& keyframe : delta.keyframes) {
    wire.keyframes().push_back(keyframe.id.value);
    wire.keyframe_parents().push_back(keyframe.parent.value);
    wire.keyframe_num_features().push_back(keyframe.num_features);
    AppendRigid3(keyframe.camera_from_map, &wire.keyframe_poses());
  }
  for (const MapDelta::PointState& point : delta.points) {
    wire.points().push_back(point.id.value);
    AppendPoint(point.position_in_map, &wire.point_positions());
  }
  ObservationsToWire(delta, &wire);
  return wire;
}

Result<MapDeltaChunk> FromWire(const wire::MapDelta& wire) {
  MessageCheck check("MapDelta");
  CheckHeader(wire, &check);
  check.AtMost("number of residuals", wire.residuals().size(), kMaxResiduals);
  for (const auto& known : wire.residuals()) {
    CheckCamera(known.camera(), &check);
    CheckResidual(known.residual(), &check);
  }
  check.AtMost("number of elements",
               wire.removed_points().size() + wire.removed_keyframes().size() + wire.keyframes().size() +
                   wire.points().size() + wire.observation_features().size(),
               kMaxChunkElements);
  CheckRemovals(wire, &check);
  CheckElements(wire, &check);
  CheckObservations(wire, &check);
  if (!check.ok()) return check.error();

  MapDeltaChunk chunk;
  chunk.index = wire.chunk_index();
  chunk.count = wire.chunk_count();
  chunk.part.map = MapId(wire.map_id());
  chunk.part.epoch = wire.epoch();
  chunk.part.base_revision = wire.base_revision();
  chunk.part.revision = wire.revision();
  for (const auto& known : wire.residuals())
    chunk.part.residuals.push_back({FromWire(known.camera()), FromWire(known.residual())});
  RemovalsFromWire(wire, &chunk.part);
  ElementsFromWire(wire, &chunk.part);
  return chunk;
}

wire::SnapshotRequest ToWire(const SnapshotRequest& request) {
  wire::SnapshotRequest wire;
  wire.map_id(request.map.value);
  wire.have_revision(request.have_revision);
  wire.asker(request.asker.value);
  for (const KeyFrameId id : request.have_keyframes) wire.have_keyframes().push_back(id.value);
  return wire;
}

Result<SnapshotRequest> FromWire(const wire::SnapshotRequest& wire) {
  MessageCheck check("SnapshotRequest");
  check.Id("map", wire.map_id());
  check.Id("asker", wire.asker());
  check.AtMost("number of keyframes", wire.have_keyframes().size(), kMaxListedKeyFrames);
  check.AllIds("have_keyframes", wire.have_keyframes());
  if (!check.ok()) return check.error();

  SnapshotRequest request;
  request.map = MapId(wire.map_id());
  request.have_revision = wire.have_revision();
  request.asker = ProcessId(wire.asker());
  for (const uint64_t id : wire.have_keyframes()) request.have_keyframes.emplace_back(id);
  return request;
}

}  // namespace portolan
