#pragma once

#include <string>
#include <string_view>

#include "base/result.h"
#include "map/keyframe.h"
#include "map/map_delta.h"

namespace portolan {

// The form in which maps are stored (not sent: that is messages/). A block of bytes each for a keyframe's data, for the
// state of a map and for a change of it:
//
//   4 bytes   what it is: "PKFD", "PMAP" or "PDLT"
//   u16       version of the form
//   ...       content (map_io.cc)
//   u64       Hasher over all before
//
// Little-endian. What is read back is equal to the bit. Decoding refuses whatever does not make a valid value: other
// versions, wrong hashes, lengths that don't fit, values that are not finite or out of range, bytes left over.

constexpr uint16_t kMapFormVersion = 2;

/// Derived fields are left out. 45 bytes a feature.
std::string EncodeKeyFrameData(const KeyFrameData& data);
/// @return the data without its derived fields (MakeKeyFrameData), or what is wrong with the bytes.
Result<KeyFrameData> DecodeKeyFrameData(std::string_view bytes);

/// @param snapshot as of Map::Snapshot(): from revision 0, without removals. Some 5 bytes an observation, 15 a point,
/// 65 a keyframe.
std::string EncodeSnapshot(const MapDelta& snapshot);
/// Whether it makes a valid map is for Map::Apply to check.
Result<MapDelta> DecodeSnapshot(std::string_view bytes);

/// @param change of Map::TakeDelta(): from one revision to a later one.
std::string EncodeChange(const MapDelta& change);
/// Whether it fits a map is for Map::Apply to check.
Result<MapDelta> DecodeChange(std::string_view bytes);

}  // namespace portolan
