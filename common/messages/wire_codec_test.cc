#include "messages/wire_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "messages/keyframe_messages.h"
#include "messages/random_messages.h"
#include "messages/status_messages.h"

namespace portolan {
namespace {

using testing::HasSubstr;

Result<wire::MapperState> Decode(const std::vector<uint8_t>& bytes) {
  return DecodeSample<wire::MapperState>(bytes.data(), bytes.size());
}

TEST(WireCodecTest, DecodingUndoesEncoding) {
  Random random(1);
  const wire::KeyFrame wire = ToWire(RandomKeyFrame(100, &random));
  const std::vector<uint8_t> bytes = EncodeSample(wire);
  const Result<wire::KeyFrame> decoded = DecodeSample<wire::KeyFrame>(bytes.data(), bytes.size());
  ASSERT_TRUE(decoded.ok());
  EXPECT_TRUE(*decoded == wire);
}

TEST(WireCodecTest, SamplesHaveALittleEndianHeaderAndNoSlack) {
  Random random(2);
  const wire::MapperState wire = ToWire(RandomMapperState(&random));
  const std::vector<uint8_t> bytes = EncodeSample(wire);
  EXPECT_EQ(bytes[0], 0);
  EXPECT_EQ(bytes[1], 1);
  EXPECT_EQ(bytes.size(), kEncapsulationBytes + wire::MapperState::getCdrSerializedSize(wire));
}

TEST(WireCodecTest, ReadsBigEndianSamples) {
  const std::vector<uint8_t> bytes = {0, 0, 0, 0,               // CDR_BE
                                      1, 2, 3, 4, 5, 6, 7, 8,   // map
                                      0, 0, 0, 0, 0, 0, 0, 9,   // revision
                                      0, 0, 0, 0, 0, 0, 0, 10,  // asker
                                      0, 0, 0, 1, 0, 0, 0, 0,   // one keyframe, padding
                                      0, 0, 0, 0, 0, 0, 0, 11};
  const Result<wire::SnapshotRequest> decoded = DecodeSample<wire::SnapshotRequest>(bytes.data(), bytes.size());
  ASSERT_TRUE(decoded.ok()) << decoded.error().message;
  EXPECT_EQ(decoded->map_id(), 0x0102030405060708u);
  EXPECT_EQ(decoded->have_revision(), 9u);
  EXPECT_EQ(decoded->asker(), 10u);
  EXPECT_EQ(decoded->have_keyframes(), std::vector<uint64_t>{11});
}

TEST(WireCodecTest, EverySampleCutShortIsRefused) {
  Random random(3);
  const std::vector<uint8_t> bytes = EncodeSample(ToWire(RandomMapperState(&random)));
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(Decode(std::vector<uint8_t>(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size))).ok())
        << size;
  }
}

TEST(WireCodecTest, OtherEncapsulationsAreRefused) {
  Random random(4);
  std::vector<uint8_t> bytes = EncodeSample(ToWire(RandomMapperState(&random)));
  bytes[1] = 3;  // PL_CDR_LE
  EXPECT_THAT(Decode(bytes).error().message, HasSubstr("encapsulation 3"));
  bytes[0] = 1;
  EXPECT_THAT(Decode(bytes).error().message, HasSubstr("encapsulation"));
}

TEST(WireCodecTest, ALengthBeyondTheSampleTakesNoMemory) {
  wire::SnapshotRequest wire;
  std::vector<uint8_t> bytes = EncodeSample(wire);
  for (size_t i = bytes.size() - 4; i < bytes.size(); ++i) bytes[i] = 0xff;  // the length of have_keyframes: 4 billion
  EXPECT_FALSE(DecodeSample<wire::SnapshotRequest>(bytes.data(), bytes.size()).ok());
}

}  // namespace
}  // namespace portolan
