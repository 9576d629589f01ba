#include "messages/correction_messages.h"

#include "messages/geometry_messages.h"
#include "messages/limits.h"
#include "messages/message_check.h"

namespace portolan {
namespace {

constexpr size_t kSim3Doubles = 1 + kRigid3Doubles;  ///< scale, then as a rigid motion

Sim3d Sim3FromArray(const double* values) {
  const Rigid3d rigid = Rigid3FromArray(values + 1);
  return Sim3d(values[0], rigid.rotation, rigid.translation);
}

template <class IdType>
void PairsToWire(const std::vector<std::pair<IdType, IdType>>& pairs, std::vector<uint64_t>* first,
                 std::vector<uint64_t>* second) {
  for (const auto& [a, b] : pairs) {
    first->push_back(a.value);
    second->push_back(b.value);
  }
}

template <class IdType>
std::vector<std::pair<IdType, IdType>> PairsFromWire(const std::vector<uint64_t>& first,
                                                     const std::vector<uint64_t>& second) {
  std::vector<std::pair<IdType, IdType>> pairs;
  pairs.reserve(first.size());
  for (size_t i = 0; i < first.size(); ++i) pairs.emplace_back(IdType(first[i]), IdType(second[i]));
  return pairs;
}

/// Ids throughout, as many on both sides, and no element with itself.
void CheckPairs(const char* field, const std::vector<uint64_t>& first, const std::vector<uint64_t>& second,
                MessageCheck* check) {
  check->AtMost(field, first.size(), kMaxCorrectedPairs);
  check->SameLength(field, second.size(), first.size());
  check->AllIds(field, first);
  check->AllIds(field, second);
  for (size_t i = 0; check->ok() && i < first.size(); ++i) {
    check->Require(first[i] != second[i], std::string(field) + " pairs an element with itself");
  }
}

void CheckObservations(const wire::MapCorrection& wire, MessageCheck* check) {
  check->AtMost("number of observations", wire.seen_points().size(), kMaxCorrectedPairs);
  check->SameLength("seen_by", wire.seen_by().size(), wire.seen_points().size());
  check->SameLength("seen_features", wire.seen_features().size(), wire.seen_points().size());
  check->AllIds("seen_points", wire.seen_points());
  check->AllIds("seen_by", wire.seen_by());
  for (const uint32_t feature : wire.seen_features()) {
    if (feature >= kMaxFeatures) check->Require(false, "seen_features holds " + std::to_string(feature));
  }
}

void CheckCorrection(const wire::MapCorrection& wire, MessageCheck* check) {
  check->Id("process", wire.process());
  check->Id("map", wire.map_id());
  check->AtMost("epoch", wire.epoch(), kMaxEpoch);
  check->AtMost("made_from_revision", wire.made_from_revision(), kMaxRevision);
  check->Name("kind", wire.kind());
  const bool is_fusion = wire.kind() == "fusion";
  check->Require(is_fusion == (wire.other() != 0),
                 "other is " + std::string(is_fusion ? "none" : "given") + " in kind " + wire.kind());
  check->Require(wire.other() != wire.map_id(), "fuses a map with itself");
  CheckSim3("map_from_other", wire.map_from_other(), check);
  check->AtMost("number of keyframes", wire.keyframes().size(), kMaxListedKeyFrames);
  check->SameLength("keyframe_poses", wire.keyframe_poses().size(), wire.keyframes().size() * kSim3Doubles);
  check->AllIds("keyframes", wire.keyframes());
  CheckPoseArray("keyframe_poses", wire.keyframe_poses(), true, check);
  check->AtMost("number of points", wire.points().size(), kMaxCorrectedPoints);
  check->SameLength("point_positions", wire.point_positions().size(), wire.points().size() * 3);
  check->AllIds("points", wire.points());
  check->AllFinite("point_positions", wire.point_positions());
  CheckPairs("merges", wire.merges_from(), wire.merges_into(), check);
  CheckObservations(wire, check);
  CheckPairs("loop_edges", wire.loop_edges_a(), wire.loop_edges_b(), check);
}

}  // namespace

wire::MapCorrection ToWire(const MapCorrection& correction) {
  wire::MapCorrection wire;
  wire.process(correction.process.value);
  wire.number(correction.number);
  wire.map_id(correction.map.value);
  wire.epoch(correction.epoch);
  wire.made_from_revision(correction.made_from_revision);
  wire.kind(correction.kind);
  wire.other(correction.other.value);
  wire.map_from_other(ToWire(correction.map_from_other));
  for (const MapCorrection::KeyFrameCorrection& keyframe : correction.keyframes) {
    const Sim3d& pose = keyframe.camera_from_map;
    wire.keyframes().push_back(keyframe.id.value);
    wire.keyframe_poses().push_back(pose.scale);
    AppendRigid3(Rigid3d(pose.rotation, pose.translation), &wire.keyframe_poses());
  }
  for (const MapCorrection::PointCorrection& point : correction.points) {
    wire.points().push_back(point.id.value);
    AppendPoint(point.position_in_map, &wire.point_positions());
  }
  PairsToWire(correction.merges, &wire.merges_from(), &wire.merges_into());
  for (const auto& [point, observation] : correction.observations) {
    wire.seen_points().push_back(point.value);
    wire.seen_by().push_back(observation.keyframe.value);
    wire.seen_features().push_back(observation.feature);
  }
  PairsToWire(correction.loop_edges, &wire.loop_edges_a(), &wire.loop_edges_b());
  return wire;
}

Result<MapCorrection> FromWire(const wire::MapCorrection& wire) {
  MessageCheck check("MapCorrection");
  CheckCorrection(wire, &check);
  if (!check.ok()) return check.error();

  MapCorrection correction;
  correction.process = ProcessId(wire.process());
  correction.number = wire.number();
  correction.map = MapId(wire.map_id());
  correction.epoch = wire.epoch();
  correction.made_from_revision = wire.made_from_revision();
  correction.kind = wire.kind();
  correction.other = MapId(wire.other());
  correction.map_from_other = FromWire(wire.map_from_other());
  for (size_t i = 0; i < wire.keyframes().size(); ++i) {
    correction.keyframes.push_back(
        {KeyFrameId(wire.keyframes()[i]), Sim3FromArray(&wire.keyframe_poses()[i * kSim3Doubles])});
  }
  for (size_t i = 0; i < wire.points().size(); ++i) {
    correction.points.push_back(
        {MapPointId(wire.points()[i]), Eigen::Map<const Eigen::Vector3f>(&wire.point_positions()[3 * i])});
  }
  correction.merges = PairsFromWire<MapPointId>(wire.merges_from(), wire.merges_into());
  for (size_t i = 0; i < wire.seen_points().size(); ++i) {
    correction.observations.emplace_back(MapPointId(wire.seen_points()[i]),
                                         Observation{KeyFrameId(wire.seen_by()[i]), wire.seen_features()[i]});
  }
  correction.loop_edges = PairsFromWire<KeyFrameId>(wire.loop_edges_a(), wire.loop_edges_b());
  return correction;
}

}  // namespace portolan
