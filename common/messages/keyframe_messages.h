#pragma once

#include "base/result.h"
#include "map/protocol.h"
#include "messages/wire.h"

namespace portolan {

/// A keyframe to the wire: 39 bytes a feature. Locations and angles are rounded to steps; features that went through
/// QuantizeFeatures come back with the same bits. The derived fields of the data are not sent.
/// @param message within limits.h, features inside the image.
wire::KeyFrame ToWire(const KeyFrameMessage& message);

/// Checks everything that a keyframe alone can show to be wrong; whether vocabulary, map and camera fit is the
/// receiver's to say.
Result<KeyFrameMessage> FromWire(const wire::KeyFrame& wire);

}  // namespace portolan
