#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace portolan {

/// What one input did: shows that a corpus reaches what it is to test.
struct FuzzOutcome {
  int taken_in = 0;  ///< messages that decoding and validation let through
  int applied = 0;   ///< deltas or corrections that changed a map
};

/// The way of a peer's bytes from the wire into this process: decoding, validation and, where there is one, application
/// to a map. Takes any bytes; refuses by a Result, never by a crash, an exception or memory out of proportion. Where a
/// map comes of it, the map is valid (ValidateMap), or a check fails.
struct FuzzTarget {
  const char* name;
  FuzzOutcome (*run)(const uint8_t* data, size_t size);
  /// Good inputs to begin with.
  std::vector<std::vector<uint8_t>> (*make_seeds)();
};

/// All of them:
/// - keyframe: one sample of the topic of keyframes;
/// - replica: keyframes and chunks of deltas, one after another, into a ReplicaSet, as every follower does: of each its
///   topic as one byte, its length as two (little-endian) and its bytes;
/// - correction: a sample of the topic of corrections, applied to a map that it may fit, and as a fusion of two;
/// - message: one sample of any other topic, which the first byte names;
/// - stored: keyframe data and map states as they lie in an atlas or a map file.
const std::vector<FuzzTarget>& FuzzTargets();

/// Null if there is none of the name.
const FuzzTarget* FindFuzzTarget(const std::string& name);

}  // namespace portolan
