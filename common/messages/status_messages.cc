#include "messages/status_messages.h"

#include <cmath>

#include "messages/geometry_messages.h"
#include "messages/limits.h"
#include "messages/message_check.h"

namespace portolan {
namespace {

/// How far a process has come in its map.
template <class Wire>
void CheckProgress(const Wire& wire, MessageCheck* check) {
  check->AtMost("epoch", wire.epoch(), kMaxEpoch);
  check->AtMost("revision", wire.revision(), kMaxRevision);
}

}  // namespace

wire::TrackerState ToWire(const TrackerState& state) {
  wire::TrackerState wire;
  wire.process(state.process.value);
  wire.frame(state.frame);
  wire.stamp_ns(state.stamp.ns);
  wire.state(static_cast<uint8_t>(state.state));
  wire.map_id(state.map.value);
  wire.camera_from_map(ToWire(state.camera_from_map));
  wire.quality(state.quality);
  wire.num_inliers(state.num_inliers);
  wire.num_candidates(state.num_candidates);
  wire.frame_ms(state.frame_ms);
  wire.interrupt_mapper(state.interrupt_mapper);
  return wire;
}

Result<TrackerState> FromWire(const wire::TrackerState& wire) {
  MessageCheck check("TrackerState");
  check.Id("process", wire.process());
  check.AtMost("state", wire.state(), static_cast<uint8_t>(TrackingState::kLost));
  CheckRigid3("camera_from_map", wire.camera_from_map(), &check);
  check.Finite("quality", wire.quality());
  check.Finite("frame_ms", wire.frame_ms());
  if (!check.ok()) return check.error();

  TrackerState state;
  state.process = ProcessId(wire.process());
  state.frame = wire.frame();
  state.stamp.ns = wire.stamp_ns();
  state.state = static_cast<TrackingState>(wire.state());
  state.map = MapId(wire.map_id());
  state.camera_from_map = FromWire(wire.camera_from_map());
  state.quality = wire.quality();
  state.num_inliers = wire.num_inliers();
  state.num_candidates = wire.num_candidates();
  state.frame_ms = wire.frame_ms();
  state.interrupt_mapper = wire.interrupt_mapper();
  return state;
}

wire::MapperState ToWire(const MapperState& state) {
  wire::MapperState wire;
  wire.process(state.process.value);
  wire.map_id(state.map.value);
  wire.epoch(state.epoch);
  wire.revision(state.revision);
  wire.idle(state.idle);
  wire.queue_depth(state.queue_depth);
  wire.last_keyframe(state.last_keyframe.value);
  wire.refused_keyframe(state.refused_keyframe.value);
  wire.refusal(state.refusal);
  wire.is_refining(state.is_refining);
  wire.correction_process(state.correction_process.value);
  wire.correction_number(state.correction_number);
  wire.correction_refusal(state.correction_refusal);
  return wire;
}

Result<MapperState> FromWire(const wire::MapperState& wire) {
  MessageCheck check("MapperState");
  check.Id("process", wire.process());
  CheckProgress(wire, &check);
  check.Text("refusal", wire.refusal(), kMaxLineBytes);
  check.Text("correction_refusal", wire.correction_refusal(), kMaxLineBytes);
  if (!check.ok()) return check.error();

  MapperState state;
  state.process = ProcessId(wire.process());
  state.map = MapId(wire.map_id());
  state.epoch = wire.epoch();
  state.revision = wire.revision();
  state.idle = wire.idle();
  state.queue_depth = wire.queue_depth();
  state.last_keyframe = KeyFrameId(wire.last_keyframe());
  state.refused_keyframe = KeyFrameId(wire.refused_keyframe());
  state.refusal = wire.refusal();
  state.is_refining = wire.is_refining();
  state.correction_process = ProcessId(wire.correction_process());
  state.correction_number = wire.correction_number();
  state.correction_refusal = wire.correction_refusal();
  return state;
}

wire::FollowerState ToWire(const FollowerState& state) {
  wire::FollowerState wire;
  wire.process(state.process.value);
  wire.map_id(state.map.value);
  wire.epoch(state.epoch);
  wire.last_keyframe(state.last_keyframe.value);
  wire.is_busy(state.is_busy);
  wire.revision(state.revision);
  return wire;
}

Result<FollowerState> FromWire(const wire::FollowerState& wire) {
  MessageCheck check("FollowerState");
  check.Id("process", wire.process());
  CheckProgress(wire, &check);
  if (!check.ok()) return check.error();

  FollowerState state;
  state.process = ProcessId(wire.process());
  state.map = MapId(wire.map_id());
  state.epoch = wire.epoch();
  state.last_keyframe = KeyFrameId(wire.last_keyframe());
  state.is_busy = wire.is_busy();
  state.revision = wire.revision();
  return state;
}

wire::ProcessStatus ToWire(const ProcessStatus& status) {
  wire::ProcessStatus wire;
  wire.process(status.process.value);
  wire.role(status.role);
  wire.host(status.host);
  wire.pid(status.pid);
  wire.vendor(status.vendor);
  wire.build(status.build);
  wire.priority(status.priority);
  wire.state(status.state);
  wire.map_id(status.map.value);
  wire.epoch(status.epoch);
  wire.revision(status.revision);
  for (const auto& [name, value] : status.figures) {
    if (!std::isfinite(value)) continue;
    wire.figure_names().push_back(name);
    wire.figure_values().push_back(value);
  }
  return wire;
}

Result<ProcessStatus> FromWire(const wire::ProcessStatus& wire) {
  MessageCheck check("ProcessStatus");
  check.Id("process", wire.process());
  CheckProgress(wire, &check);
  check.Name("role", wire.role());
  check.Text("host", wire.host(), kMaxLineBytes);
  check.Text("vendor", wire.vendor(), kMaxLineBytes);
  check.Text("build", wire.build(), kMaxLineBytes);
  check.Text("priority", wire.priority(), kMaxLineBytes);
  check.Text("state", wire.state(), kMaxLineBytes);
  check.AtMost("number of figures", wire.figure_names().size(), kMaxFigures);
  check.SameLength("figure_values", wire.figure_values().size(), wire.figure_names().size());
  for (const std::string& name : wire.figure_names()) check.Name("figure_names", name);
  check.AllFinite("figure_values", wire.figure_values());
  if (!check.ok()) return check.error();

  ProcessStatus status;
  status.process = ProcessId(wire.process());
  status.role = wire.role();
  status.host = wire.host();
  status.pid = wire.pid();
  status.vendor = wire.vendor();
  status.build = wire.build();
  status.priority = wire.priority();
  status.state = wire.state();
  status.map = MapId(wire.map_id());
  status.epoch = wire.epoch();
  status.revision = wire.revision();
  for (size_t i = 0; i < wire.figure_names().size(); ++i) {
    status.figures.emplace_back(wire.figure_names()[i], wire.figure_values()[i]);
  }
  return status;
}

}  // namespace portolan
