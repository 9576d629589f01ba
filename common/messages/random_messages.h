#pragma once

#include "base/random.h"
#include "dataset/image_source.h"
#include "map/protocol.h"

namespace portolan {

// Valid messages with random content, for tests of round trips and of the transport. Features are quantised, so that
// they come back as they went.

Rigid3d RandomRigid3(Random* random);
Sim3d RandomSim3(Random* random);
FeatureSet RandomFeatures(size_t n, const PinholeCamera& camera, Random* random);
/// With half of the features seeing landmarks. @param n features.
KeyFrameMessage RandomKeyFrame(size_t n, Random* random);
/// With `n` points, n / 100 keyframes, 5 observations a point, and some removals.
MapDeltaChunk RandomDelta(size_t n, Random* random);
SnapshotRequest RandomSnapshotRequest(Random* random);
MapCorrection RandomCorrection(Random* random);
Command RandomCommand(Random* random);
Request RandomRequest(Random* random);
Reply RandomReply(Random* random);
TrackerState RandomTrackerState(Random* random);
MapperState RandomMapperState(Random* random);
FollowerState RandomFollowerState(Random* random);
ProcessStatus RandomProcessStatus(Random* random);
Image RandomImage(int width, int height, Random* random);

}  // namespace portolan
