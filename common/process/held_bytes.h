#pragma once

#include <cstddef>

#include "map/protocol.h"

namespace portolan {

// What a message keeps in memory while it waits in a process's loop (ProcessLoop::Post), about. Other messages are
// small, or have their text bounded (messages/limits.h).

template <class Message>
size_t HeldBytes(const Message& /*message*/) {
  return 0;
}

inline size_t HeldBytes(const KeyFrameMessage& message) {
  constexpr size_t kFeatureBytes = sizeof(Eigen::Vector2f) + sizeof(uint8_t) + sizeof(float) + sizeof(Descriptor);
  return sizeof message + message.data.features.size() * kFeatureBytes +
         message.landmarks.size() * sizeof message.landmarks[0] +
         message.initial_matches.size() * sizeof message.initial_matches[0];
}

inline size_t HeldBytes(const MapDeltaChunk& chunk) {
  const MapDelta& part = chunk.part;
  return sizeof chunk + part.removed_points.size() * sizeof(MapDelta::RemovedPoint) +
         part.removed_keyframes.size() * sizeof(MapDelta::RemovedKeyFrame) +
         part.keyframes.size() * sizeof(MapDelta::KeyFrameState) + part.points.size() * sizeof(MapDelta::PointState) +
         part.observations.size() * sizeof(MapDelta::ObservationState);
}

inline size_t HeldBytes(const MapCorrection& correction) {
  return sizeof correction + correction.keyframes.size() * sizeof correction.keyframes[0] +
         correction.points.size() * sizeof correction.points[0] +
         correction.merges.size() * sizeof correction.merges[0] +
         correction.observations.size() * sizeof correction.observations[0] +
         correction.loop_edges.size() * sizeof correction.loop_edges[0];
}

inline size_t HeldBytes(const SnapshotRequest& request) {
  return sizeof request + request.have_keyframes.size() * sizeof(KeyFrameId);
}

}  // namespace portolan
