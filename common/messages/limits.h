#pragma once

#include <cstddef>
#include <cstdint>

namespace portolan {

// Bounds on what one message may hold. A sender keeps to them; a message from the network beyond them is refused, so
// that a broken or hostile peer can't make a process allocate or work without bound.

/// Features of a keyframe: indices are 16 bit on the wire and 65535 means "none"; ten times the default of 2000 is room
/// enough.
constexpr size_t kMaxFeatures = 20000;
/// Levels of an image pyramid: at factor 1.2 the 32nd is 300 times smaller, beyond any image.
constexpr int kMaxPyramidLevels = 32;
/// Sides of an image, pixels: feature locations are 16-bit fixed point.
constexpr int kMaxImageSide = 16384;

/// Elements of a delta chunk, summed over its lists, that senders should aim at: at 4 to 80 bytes each, 100 to 300 KB a
/// chunk.
constexpr size_t kDeltaChunkElements = 8192;
/// Elements of a delta chunk that the wire can carry: the table of observing keyframes has 16-bit indices.
constexpr size_t kMaxChunkElements = 65535;
/// Chunks of one delta: 8 billion elements is beyond any map.
constexpr uint32_t kMaxChunks = 1u << 17;

/// Keyframes named in one snapshot request or correction: a hundred hours of mapping at one keyframe in three seconds.
constexpr size_t kMaxListedKeyFrames = 120000;
/// Points in one correction.
constexpr size_t kMaxCorrectedPoints = 4000000;
/// Merges of points, or loop edges, in one correction.
constexpr size_t kMaxCorrectedPairs = 1000000;

/// Epochs and revisions: one a millisecond for nine thousand years. A process counts on from those it hears, which must
/// not run over.
constexpr uint64_t kMaxEpoch = uint64_t{1} << 48, kMaxRevision = uint64_t{1} << 48;

/// Cameras of a map whose residuals are known.
constexpr size_t kMaxResiduals = 64;

/// Bytes of a name ("loop", "frontend_tracker"), of a line of text (reasons, states), and of a whole answer (a list of
/// maps as JSON).
constexpr size_t kMaxNameBytes = 128;
constexpr size_t kMaxLineBytes = 4096;
constexpr size_t kMaxTextBytes = 4u << 20;
/// Figures in a process's status.
constexpr size_t kMaxFigures = 512;

/// Bytes of a compressed image, and of any sample at all (Cyclone DDS drops larger ones before they reach us).
constexpr size_t kMaxCompressedImageBytes = 32u << 20;
constexpr size_t kMaxSampleBytes = 256u << 20;

}  // namespace portolan
