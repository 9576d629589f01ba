#include <gtest/gtest.h>

#include "messages/random_messages.h"
#include "messages/wire_codec.h"
#include "transport/bus_testing.h"
#include "transport/raw_bus.h"
#include "transport/topics.h"

// What goes wrong on a bus: processes that end or hang, messages that are malformed. On any pair of vendors.

namespace portolan {
namespace {

using VendorPair = std::tuple<DdsVendor, DdsVendor>;

class BusFailureTest : public testing::TestWithParam<VendorPair> {
 protected:
  Random random_{11};
  std::unique_ptr<Bus> writing_ = MakeTestBus(std::get<0>(GetParam()));
  std::unique_ptr<Bus> reading_ = MakeTestBus(std::get<1>(GetParam()));
};

TEST_P(BusFailureTest, AWriterThatStopsAssertingIsNoticedAndSoIsItsReturn) {
  Inbox<int> alive;
  const auto reader =
      reading_->CreateReader<ProcessStatus>([](ProcessStatus) {}, [&](int writers) { alive.Put(writers); });
  const auto writer = writing_->CreateWriter<ProcessStatus>();
  writer->Write(RandomProcessStatus(&random_));  // which asserts it too
  ASSERT_TRUE(alive.WaitUntilAny([](int writers) { return writers == 1; }));
  ASSERT_TRUE(alive.WaitUntilAny([](int writers) { return writers == 0; }));  // silence
  EXPECT_EQ(reader->AliveWriters(), 0);
  EXPECT_EQ(reader->MatchedWriters(), 1);
  const size_t before = alive.values().size();
  writer->Write(RandomProcessStatus(&random_));  // its next status
  ASSERT_TRUE(alive.WaitFor(before + 1));
  EXPECT_EQ(alive.values()[before], 1);
}

TEST_P(BusFailureTest, AWriterThatEndsIsNoticed) {
  Inbox<int> alive;
  const auto reader =
      reading_->CreateReader<ProcessStatus>([](ProcessStatus) {}, [&](int writers) { alive.Put(writers); });
  auto writer = writing_->CreateWriter<ProcessStatus>();
  writer->Write(RandomProcessStatus(&random_));
  ASSERT_TRUE(alive.WaitUntilAny([](int writers) { return writers == 1; }));
  writer.reset();
  ASSERT_TRUE(alive.WaitUntilAny([](int writers) { return writers == 0; }));
  EXPECT_EQ(reader->AliveWriters(), 0);
}

TEST_P(BusFailureTest, OneDeadWriterOfTwoIsNoticed) {
  Inbox<int> alive;
  const auto reader =
      reading_->CreateReader<ProcessStatus>([](ProcessStatus) {}, [&](int writers) { alive.Put(writers); });
  const std::unique_ptr<Bus> second_bus = MakeTestBus(std::get<0>(GetParam()));
  const auto first = writing_->CreateWriter<ProcessStatus>();
  const auto second = second_bus->CreateWriter<ProcessStatus>();
  // Both alive at once; then only the first goes on asserting.
  const auto deadline = std::chrono::steady_clock::now() + kTestDeadline;
  while (reader->AliveWriters() < 2 && std::chrono::steady_clock::now() < deadline) {
    const size_t before = alive.values().size();
    first->AssertLiveliness();
    second->AssertLiveliness();
    alive.WaitFor(before + 1, std::chrono::milliseconds(100));
  }
  ASSERT_EQ(reader->AliveWriters(), 2);
  while (reader->AliveWriters() != 1 && std::chrono::steady_clock::now() < deadline) {
    const size_t before = alive.values().size();
    first->AssertLiveliness();
    alive.WaitFor(before + 1, std::chrono::milliseconds(100));
  }
  EXPECT_EQ(reader->AliveWriters(), 1);
}

/// Writes bytes as they are on a topic, past conversion and serialisation.
class RawWriting {
 public:
  explicit RawWriting(DdsVendor vendor, const RawTopic& topic) {
    bus_ = MakeRawBus(TestOptions(vendor)).value();
    writer_ = bus_->CreateWriter(topic).value();
  }
  Status Write(SampleBytes bytes) { return writer_->Write(std::move(bytes)); }

 private:
  std::unique_ptr<RawBus> bus_;
  std::unique_ptr<RawWriter> writer_;
};

template <class T>
RawTopic TopicOf() {
  return RawTopic{Topic<T>::kName, Topic<T>::kType, Topic<T>::kKeyed, Topic<T>::Qos()};
}

/// Malformed samples are counted and dropped, and the reader goes on: the good message after them arrives. Keyed and
/// unkeyed topics, samples shorter than a key or a header among them.
template <class T>
void ExpectMalformedToBeCounted(const VendorPair& vendors, Bus* reading, const T& good) {
  RawWriting raw(std::get<0>(vendors), TopicOf<T>());
  Inbox<T> inbox;
  const auto reader = reading->CreateReader<T>([&](T message) { inbox.Put(std::move(message)); });
  const SampleBytes good_bytes = EncodeSample(ToWire(good));
  const auto deadline = std::chrono::steady_clock::now() + kTestDeadline;
  while (std::chrono::steady_clock::now() < deadline && !inbox.WaitFor(1, std::chrono::milliseconds(50))) {
    (void)raw.Write(good_bytes).ok();  // a full writer refuses until the reader has found it
  }
  ASSERT_TRUE(inbox.WaitFor(1));

  Random random(12);
  const uint64_t before = reading->Counters().at(Topic<T>::kName).malformed;
  EXPECT_EQ(before, 0u);
  for (const size_t size : {size_t{4}, size_t{5}, size_t{12}, size_t{100}, size_t{100000}}) {
    SampleBytes noise(size);
    for (uint8_t& byte : noise) byte = static_cast<uint8_t>(random.Next());
    noise[0] = 0;
    noise[1] = 1;
    ASSERT_TRUE(raw.Write(std::move(noise)).ok());
    const size_t received = inbox.values().size();
    ASSERT_TRUE(raw.Write(good_bytes).ok());
    ASSERT_TRUE(inbox.WaitFor(received + 1)) << "after " << size << " bytes of noise";
  }
  EXPECT_GE(reading->Counters().at(Topic<T>::kName).malformed, 1u);
}

TEST_P(BusFailureTest, MalformedSamplesOfAnUnkeyedTopicAreCountedAndDropped) {
  ExpectMalformedToBeCounted(GetParam(), reading_.get(), RandomCorrection(&random_));
}

TEST_P(BusFailureTest, MalformedSamplesOfAKeyedTopicAreCountedAndDropped) {
  ExpectMalformedToBeCounted(GetParam(), reading_.get(), RandomProcessStatus(&random_));
}

TEST_P(BusFailureTest, AMessageThatFailsValidationIsCounted) {
  Inbox<Request> inbox;
  const auto reader = reading_->CreateReader<Request>([&](Request request) { inbox.Put(std::move(request)); });
  const auto writer = writing_->CreateWriter<Request>();
  ASSERT_TRUE(PublishUntilReceived(writer.get(), RandomRequest(&random_), &inbox));
  Request nobodys = RandomRequest(&random_);
  nobodys.sender = ProcessId();
  ASSERT_TRUE(writer->Write(nobodys));
  Request last = RandomRequest(&random_);
  last.kind = "last";
  ASSERT_TRUE(writer->Write(last));
  ASSERT_TRUE(inbox.WaitUntilAny(
      [](const Request& request) { return request.kind == "last"; }));  // in order: the bad one is through
  EXPECT_EQ(reading_->Counters().at("request").malformed, 1u);
}

TEST_P(BusFailureTest, ReadersEndWhileSamplesCome) {
  const auto writer = writing_->CreateWriter<MapperState>();
  const MapperState state = RandomMapperState(&random_);
  for (int i = 0; i < 10; ++i) {
    Inbox<MapperState> inbox;
    const auto reader =
        reading_->CreateReader<MapperState>([&](MapperState received) { inbox.Put(std::move(received)); });
    ASSERT_TRUE(PublishUntilReceived(writer.get(), state, &inbox));
    for (int k = 0; k < 100; ++k) writer->Write(state);
  }
}

std::string PairName(const testing::TestParamInfo<VendorPair>& info) {
  return ToString(std::get<0>(info.param)) + "_to_" + ToString(std::get<1>(info.param));
}

INSTANTIATE_TEST_SUITE_P(Vendors, BusFailureTest,
                         testing::Combine(testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds),
                                          testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds)),
                         PairName);

}  // namespace
}  // namespace portolan
