#pragma once

#include "base/result.h"
#include "map/protocol.h"
#include "messages/wire.h"

namespace portolan {

wire::Command ToWire(const Command& command);
/// Each kind's own needs are checked too: a grant without an owner or an epoch, maps named together with themselves are
/// refused.
Result<Command> FromWire(const wire::Command& wire);

wire::Request ToWire(const Request& request);
Result<Request> FromWire(const wire::Request& wire);

wire::Reply ToWire(const Reply& reply);
Result<Reply> FromWire(const wire::Reply& wire);

}  // namespace portolan
