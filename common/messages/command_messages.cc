#include "messages/command_messages.h"

#include "messages/geometry_messages.h"
#include "messages/limits.h"
#include "messages/message_check.h"

namespace portolan {
namespace {

bool NamesMap(CommandKind kind) {
  switch (kind) {
    case CommandKind::kGrantOwnership:
    case CommandKind::kActivateMap:
    case CommandKind::kFuseMaps:
    case CommandKind::kLinkMaps:
    case CommandKind::kAdjustMap:
    case CommandKind::kForgetMap:
      return true;
    default:
      return false;  // of a robot
  }
}

bool NamesProcess(CommandKind kind) {
  switch (kind) {
    case CommandKind::kGrantOwnership:
    case CommandKind::kDrain:
    case CommandKind::kAppointMapper:
    case CommandKind::kAppointLoopCloser:
    case CommandKind::kAppointAtlasServer:
      return true;
    default:
      return false;
  }
}

void CheckKind(const wire::Command& wire, MessageCheck* check) {
  check->AtMost("kind", wire.kind(), static_cast<uint8_t>(CommandKind::kAppointAtlasServer));
  check->AtMost("epoch", wire.epoch(), kMaxEpoch);
  const auto kind = static_cast<CommandKind>(wire.kind());
  if (NamesMap(kind)) check->Id("map", wire.map_id());
  if (NamesProcess(kind)) check->Id("owner", wire.owner());
  if (kind == CommandKind::kGrantOwnership) check->Require(wire.epoch() > 0, "epoch of a grant is 0");
  if (kind == CommandKind::kFuseMaps || kind == CommandKind::kLinkMaps) check->Id("other", wire.other());
  if (NamesMap(kind)) check->Require(wire.other() != wire.map_id(), "names a map together with itself");
}

}  // namespace

wire::Command ToWire(const Command& command) {
  wire::Command wire;
  wire.number(command.number);
  wire.sender(command.sender.value);
  wire.kind(static_cast<uint8_t>(command.kind));
  wire.map_id(command.map.value);
  wire.other(command.other.value);
  wire.epoch(command.epoch);
  wire.owner(command.owner.value);
  wire.robot(command.robot);
  wire.map_from_other(ToWire(command.map_from_other));
  return wire;
}

Result<Command> FromWire(const wire::Command& wire) {
  MessageCheck check("Command");
  check.Id("sender", wire.sender());
  CheckKind(wire, &check);
  CheckSim3("map_from_other", wire.map_from_other(), &check);
  if (!check.ok()) return check.error();

  Command command;
  command.number = wire.number();
  command.sender = ProcessId(wire.sender());
  command.kind = static_cast<CommandKind>(wire.kind());
  command.map = MapId(wire.map_id());
  command.other = MapId(wire.other());
  command.epoch = wire.epoch();
  command.owner = ProcessId(wire.owner());
  command.robot = wire.robot();
  command.map_from_other = FromWire(wire.map_from_other());
  return command;
}

wire::Request ToWire(const Request& request) {
  wire::Request wire;
  wire.id(request.id.value);
  wire.sender(request.sender.value);
  wire.kind(request.kind);
  wire.map_id(request.map.value);
  wire.other(request.other.value);
  wire.map_from_other(ToWire(request.map_from_other));
  wire.argument(request.argument);
  return wire;
}

Result<Request> FromWire(const wire::Request& wire) {
  MessageCheck check("Request");
  check.Id("id", wire.id());
  check.Id("sender", wire.sender());
  check.Name("kind", wire.kind());
  CheckSim3("map_from_other", wire.map_from_other(), &check);
  check.Text("argument", wire.argument(), kMaxLineBytes);
  if (!check.ok()) return check.error();

  Request request;
  request.id = RequestId(wire.id());
  request.sender = ProcessId(wire.sender());
  request.kind = wire.kind();
  request.map = MapId(wire.map_id());
  request.other = MapId(wire.other());
  request.map_from_other = FromWire(wire.map_from_other());
  request.argument = wire.argument();
  return request;
}

wire::Reply ToWire(const Reply& reply) {
  wire::Reply wire;
  wire.id(reply.id.value);
  wire.sender(reply.sender.value);
  wire.ok(reply.ok);
  wire.reason(reply.reason);
  wire.text(reply.text);
  return wire;
}

Result<Reply> FromWire(const wire::Reply& wire) {
  MessageCheck check("Reply");
  check.Id("id", wire.id());
  check.Id("sender", wire.sender());
  check.Text("reason", wire.reason(), kMaxLineBytes);
  check.Text("text", wire.text(), kMaxTextBytes);
  if (!check.ok()) return check.error();

  Reply reply;
  reply.id = RequestId(wire.id());
  reply.sender = ProcessId(wire.sender());
  reply.ok = wire.ok();
  reply.reason = wire.reason();
  reply.text = wire.text();
  return reply;
}

}  // namespace portolan
