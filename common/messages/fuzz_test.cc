#include <gtest/gtest.h>

#include "messages/command_messages.h"
#include "messages/correction_messages.h"
#include "messages/delta_messages.h"
#include "messages/image_messages.h"
#include "messages/keyframe_messages.h"
#include "messages/random_messages.h"
#include "messages/status_messages.h"
#include "messages/wire_codec.h"

// Whatever the network delivers, decoding and validation end with a message or a reason: no crash, no exception, no
// huge allocation. Run it with the address sanitizer to see more.

namespace portolan {
namespace {

constexpr int kRounds = 2000;

/// What comes of bytes, as a process would take them in.
template <class Wire>
bool TakeIn(const std::vector<uint8_t>& bytes) {
  const Result<Wire> wire = DecodeSample<Wire>(bytes.data(), bytes.size());
  return wire.ok() && FromWire(*wire).ok();
}

template <class Wire>
void FuzzWithNoise(uint64_t seed) {
  Random random(seed);
  int taken_in = 0;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<uint8_t> bytes(random.Below(400));
    for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random.Next());
    if (bytes.size() >= 4)
      bytes[0] = 0, bytes[1] = static_cast<uint8_t>(random.Below(2));  // else the header refuses nearly all
    taken_in += TakeIn<Wire>(bytes) ? 1 : 0;
  }
  EXPECT_EQ(taken_in, 0);  // ids, unit quaternions and lengths don't come about by chance
}

/// A few bytes of a good message are changed, or its end is cut off.
template <class Wire>
void FuzzWithDamage(const Wire& good, uint64_t seed) {
  Random random(seed);
  const std::vector<uint8_t> bytes = EncodeSample(good);
  ASSERT_TRUE(TakeIn<Wire>(bytes));
  int refused = 0;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<uint8_t> damaged = bytes;
    for (uint64_t i = random.Below(4); i < 4; ++i)
      damaged[random.Below(damaged.size())] = static_cast<uint8_t>(random.Next());
    if (random.Below(4) == 0) damaged.resize(random.Below(damaged.size()));
    refused += TakeIn<Wire>(damaged) ? 0 : 1;
  }
  EXPECT_GT(refused, kRounds / 5);  // all that are cut short, at least
}

template <class Wire>
void Fuzz(const Wire& good) {
  FuzzWithNoise<Wire>(1);
  FuzzWithDamage(good, 2);
}

TEST(FuzzTest, KeyFrames) {
  Random random(1);
  Fuzz(ToWire(RandomKeyFrame(20, &random)));
}
TEST(FuzzTest, MapDeltas) {
  Random random(2);
  Fuzz(ToWire(RandomDelta(10, &random)));
}
TEST(FuzzTest, SnapshotRequests) {
  Random random(3);
  Fuzz(ToWire(RandomSnapshotRequest(&random)));
}
TEST(FuzzTest, Corrections) {
  Random random(4);
  Fuzz(ToWire(RandomCorrection(&random)));
}
TEST(FuzzTest, Commands) {
  Random random(5);
  Fuzz(ToWire(RandomCommand(&random)));
}
TEST(FuzzTest, Requests) {
  Random random(6);
  Fuzz(ToWire(RandomRequest(&random)));
}
TEST(FuzzTest, Replies) {
  Random random(7);
  Fuzz(ToWire(RandomReply(&random)));
}
TEST(FuzzTest, TrackerStates) {
  Random random(8);
  Fuzz(ToWire(RandomTrackerState(&random)));
}
TEST(FuzzTest, FollowerStates) {
  Random random(26);
  FuzzWithDamage(ToWire(RandomFollowerState(&random)), 2);  // noise could pass: ids and numbers are all it has
}

TEST(FuzzTest, MapperStates) {
  Random random(9);
  FuzzWithDamage(ToWire(RandomMapperState(&random)), 2);  // noise could pass: ids and numbers are all it has
}
TEST(FuzzTest, ProcessStatuses) {
  Random random(10);
  Fuzz(ToWire(RandomProcessStatus(&random)));
}
TEST(FuzzTest, Images) {
  Random random(11);
  Fuzz(ToWire(RandomImage(8, 6, &random)));
}

}  // namespace
}  // namespace portolan
