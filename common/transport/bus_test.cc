#include "transport/bus.h"

#include <gtest/gtest.h>

#include <tuple>

#include "messages/random_messages.h"
#include "messages/wire_codec.h"
#include "transport/bus_testing.h"
#include "transport/topics.h"

namespace portolan {
namespace {

/// A writing and a reading bus, on any pair of vendors.
class BusPairTest : public testing::TestWithParam<std::tuple<DdsVendor, DdsVendor>> {
 protected:
  /// Sends one message and expects it back as it was, to the byte of its wire form.
  template <class T>
  void ExpectDelivered(const T& message) {
    Inbox<T> inbox;
    const auto reader = reading_->CreateReader<T>([&](T received) { inbox.Put(std::move(received)); });
    const auto writer = writing_->CreateWriter<T>();
    ASSERT_TRUE(PublishUntilReceived(writer.get(), message, &inbox));
    EXPECT_TRUE(EncodeSample(ToWire(inbox.values().front())) == EncodeSample(ToWire(message)));
    EXPECT_EQ(writer->MatchedReaders(), 1);
    EXPECT_EQ(reader->MatchedWriters(), 1);
  }

  Random random_{7};
  std::unique_ptr<Bus> writing_ = MakeTestBus(std::get<0>(GetParam()));
  std::unique_ptr<Bus> reading_ = MakeTestBus(std::get<1>(GetParam()));
};

TEST_P(BusPairTest, CarriesKeyFramesOf2000Features) {
  const KeyFrameMessage message = RandomKeyFrame(2000, &random_);
  ExpectDelivered(message);
  RecordProperty("keyframe_bytes", static_cast<int>(EncodeSample(ToWire(message)).size()));
}
TEST_P(BusPairTest, CarriesMapDeltas) {
  ExpectDelivered(RandomDelta(8000, &random_));
}
TEST_P(BusPairTest, CarriesSnapshotRequests) {
  ExpectDelivered(RandomSnapshotRequest(&random_));
}
TEST_P(BusPairTest, CarriesCorrections) {
  ExpectDelivered(RandomCorrection(&random_));
}
TEST_P(BusPairTest, CarriesCommands) {
  ExpectDelivered(RandomCommand(&random_));
}
TEST_P(BusPairTest, CarriesRequests) {
  ExpectDelivered(RandomRequest(&random_));
}
TEST_P(BusPairTest, CarriesReplies) {
  ExpectDelivered(RandomReply(&random_));
}
TEST_P(BusPairTest, CarriesTrackerStates) {
  ExpectDelivered(RandomTrackerState(&random_));
}
TEST_P(BusPairTest, CarriesFollowerStates) {
  ExpectDelivered(RandomFollowerState(&random_));
}
TEST_P(BusPairTest, CarriesMapperStates) {
  ExpectDelivered(RandomMapperState(&random_));
}
TEST_P(BusPairTest, CarriesProcessStatuses) {
  ExpectDelivered(RandomProcessStatus(&random_));
}
TEST_P(BusPairTest, CarriesImages) {
  ExpectDelivered(RandomImage(1241, 376, &random_));
}

TEST_P(BusPairTest, NumbersImagesAsTheyCome) {
  Inbox<Image> inbox;
  const auto reader = reading_->CreateReader<Image>([&](Image received) { inbox.Put(std::move(received)); });
  const auto writer = writing_->CreateWriter<Image>();
  const Image image = RandomImage(64, 48, &random_);
  ASSERT_TRUE(PublishUntilReceived(writer.get(), image, &inbox));
  for (int i = 0; i < 3; ++i) {  // best effort: one after another
    const size_t before = inbox.values().size();
    writer->Write(image);
    ASSERT_TRUE(inbox.WaitFor(before + 1));
  }
  const std::vector<Image> images = inbox.values();
  for (size_t i = 0; i < images.size(); ++i) EXPECT_EQ(images[i].frame, i);
}

TEST_P(BusPairTest, KeepsTheOrderOfAReliableTopicAndLosesNothing) {
  constexpr uint32_t kCount = 500;
  Inbox<MapperState> inbox;
  const auto reader =
      reading_->CreateReader<MapperState>([&](MapperState received) { inbox.Put(std::move(received)); });
  const auto writer = writing_->CreateWriter<MapperState>();
  MapperState state;
  state.process = ProcessId(1, 2, 3);
  state.queue_depth = 0;
  ASSERT_TRUE(PublishUntilReceived(writer.get(), state, &inbox));
  for (uint32_t i = 1; i <= kCount; ++i) {
    state.queue_depth = i;
    ASSERT_TRUE(writer->Write(state));
  }
  ASSERT_TRUE(inbox.WaitUntilAny([&](const MapperState& s) { return s.queue_depth == kCount; }));
  uint32_t expected = 0;
  for (const MapperState& received : inbox.values()) {
    if (received.queue_depth == 0) continue;  // of the greeting
    EXPECT_EQ(received.queue_depth, ++expected);
  }
  EXPECT_EQ(expected, kCount);
  EXPECT_TRUE(writer->WaitForAcknowledgments(10.0));
}

TEST_P(BusPairTest, ALateReaderGetsTheLastStatusAndAllCommands) {
  const auto statuses = writing_->CreateWriter<ProcessStatus>();
  const auto commands = writing_->CreateWriter<Command>();
  ProcessStatus status = RandomProcessStatus(&random_);
  status.state = "old";
  statuses->Write(status);
  status.state = "new";
  statuses->Write(status);
  Command command = RandomCommand(&random_);
  for (command.number = 1; command.number <= 5; ++command.number) commands->Write(command);

  Inbox<ProcessStatus> status_inbox;
  Inbox<Command> command_inbox;
  const auto status_reader =
      reading_->CreateReader<ProcessStatus>([&](ProcessStatus s) { status_inbox.Put(std::move(s)); });
  const auto command_reader = reading_->CreateReader<Command>([&](Command c) { command_inbox.Put(c); });
  ASSERT_TRUE(status_inbox.WaitFor(1));
  EXPECT_EQ(status_inbox.values().front().state, "new");
  ASSERT_TRUE(command_inbox.WaitFor(5));
  for (uint64_t i = 0; i < 5; ++i) EXPECT_EQ(command_inbox.values()[i].number, i + 1);
}

TEST_P(BusPairTest, PartitionsKeepRobotsApart) {
  const std::unique_ptr<Bus> other = MakeTestBus(std::get<0>(GetParam()), "other");
  Inbox<MapperState> inbox;
  const auto reader =
      reading_->CreateReader<MapperState>([&](MapperState received) { inbox.Put(std::move(received)); });
  const auto writer = writing_->CreateWriter<MapperState>();
  const auto other_writer = other->CreateWriter<MapperState>();
  // The other robot's writer and reader know each other before anything is expected of the first.
  Inbox<MapperState> other_inbox;
  const auto other_reader =
      other->CreateReader<MapperState>([&](MapperState received) { other_inbox.Put(std::move(received)); });
  const MapperState mine = RandomMapperState(&random_), others = RandomMapperState(&random_);
  ASSERT_TRUE(PublishUntilReceived(other_writer.get(), others, &other_inbox));
  ASSERT_TRUE(PublishUntilReceived(writer.get(), mine, &inbox));
  other_writer->Write(others);
  EXPECT_EQ(other_writer->MatchedReaders(), 1);  // its own
  EXPECT_EQ(reader->MatchedWriters(), 1);
  for (const MapperState& received : inbox.values()) EXPECT_EQ(received.refusal, mine.refusal);
}

TEST_P(BusPairTest, AWildcardPartitionSeesEveryRobot) {
  const std::unique_ptr<Bus> all = MakeTestBus(std::get<1>(GetParam()), "te*");
  Inbox<MapperState> inbox;
  const auto reader = all->CreateReader<MapperState>([&](MapperState received) { inbox.Put(std::move(received)); });
  const auto writer = writing_->CreateWriter<MapperState>();
  EXPECT_TRUE(PublishUntilReceived(writer.get(), RandomMapperState(&random_), &inbox));
}

TEST_P(BusPairTest, CountsSamplesAndBytes) {
  Inbox<Request> inbox;
  const auto reader = reading_->CreateReader<Request>([&](Request received) { inbox.Put(std::move(received)); });
  const auto writer = writing_->CreateWriter<Request>();
  const Request request = RandomRequest(&random_);
  ASSERT_TRUE(PublishUntilReceived(writer.get(), request, &inbox));
  const size_t bytes = EncodeSample(ToWire(request)).size();
  const TopicCounters sent = writing_->Counters().at("request");
  EXPECT_GE(sent.sent, 1u);
  EXPECT_EQ(sent.sent_bytes, sent.sent * bytes);
  EXPECT_EQ(sent.received, 0u);
  const TopicCounters received = reading_->Counters().at("request");
  EXPECT_GE(received.received, 1u);
  EXPECT_EQ(received.received_bytes, received.received * bytes);
  EXPECT_EQ(received.malformed, 0u);
}

std::string PairName(const testing::TestParamInfo<std::tuple<DdsVendor, DdsVendor>>& info) {
  return ToString(std::get<0>(info.param)) + "_to_" + ToString(std::get<1>(info.param));
}

INSTANTIATE_TEST_SUITE_P(Vendors, BusPairTest,
                         testing::Combine(testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds),
                                          testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds)),
                         PairName);

}  // namespace
}  // namespace portolan
