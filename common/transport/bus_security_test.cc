#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <ctime>

#include "dataset/temp_folder.h"
#include "messages/random_messages.h"
#include "messages/wire_codec.h"
#include "transport/bus_testing.h"
#include "transport/credentials_testing.h"
#include "transport/raw_bus.h"
#include "transport/topics.h"

// DDS Security over the loopback, among participants of one vendor: mixed ones do not work (design/dds.md). Cyclone DDS
// holds all participants of a process to the permissions of the first: where a test has several of it, they have one
// grant for all. Different roles meet as processes in test/processes/security_test.cc.

namespace portolan {
namespace {

using testing::HasSubstr;

class BusSecurityTest : public testing::TestWithParam<DdsVendor> {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TempFolder>();
    keys_ = std::make_unique<TestKeys>(folder_->Path("keys"));
    PermissionScope scope;
    scope.partitions = {"test*"};
    for (const char* role : {"frontend_tracker", "backend_mapper", "tool"}) keys_->Make(role, scope);
    keys_->MakeGrant("everybody", kRoleTracker | kRoleMapper | kRoleTool, scope);
  }
  static void TearDownTestSuite() {
    keys_.reset();
    folder_.reset();
  }

  static BusOptions OptionsOf(const std::string& role) {
    BusOptions options = TestOptions(GetParam());
    options.credentials_folder = keys_->Folder(role);
    return options;
  }
  /// Beside others in this process.
  static BusOptions OptionsAmongOthers(const std::string& role) {
    return OptionsOf(GetParam() == DdsVendor::kFastDds ? role : "everybody");
  }
  static std::unique_ptr<Bus> Join(const std::string& role) { return MakeTestBus(OptionsAmongOthers(role)); }

  template <class T>
  void ExpectDelivered(Bus* writing, Bus* reading, const T& message) {
    Inbox<T> inbox;
    const auto reader = reading->CreateReader<T>([&](T received) { inbox.Put(std::move(received)); });
    const auto writer = writing->CreateWriter<T>();
    ASSERT_TRUE(PublishUntilReceived(writer.get(), message, &inbox));
    EXPECT_TRUE(EncodeSample(ToWire(inbox.values().front())) == EncodeSample(ToWire(message)));
  }

  static inline std::unique_ptr<TempFolder> folder_;
  static inline std::unique_ptr<TestKeys> keys_;
  Random random_{17};
};

TEST_P(BusSecurityTest, WhoHasPermissionIsHeard) {
  const auto tracker = Join("frontend_tracker"), mapper = Join("backend_mapper");
  ExpectDelivered(tracker.get(), mapper.get(), RandomKeyFrame(2500, &random_));  // in fragments
  ExpectDelivered(mapper.get(), tracker.get(), RandomMapperState(&random_));
}

TEST_P(BusSecurityTest, SmallDatagramsCarryLargeMessagesOrAreRefused) {
  BusOptions tracker_options = OptionsAmongOthers("frontend_tracker"),
             mapper_options = OptionsAmongOthers("backend_mapper");
  tracker_options.small_datagrams = mapper_options.small_datagrams = true;
  if (GetParam() == DdsVendor::kFastDds) {
    EXPECT_THAT(tracker_options.Check().error().message, HasSubstr("dds.small_datagrams and dds.security"));
    return;
  }
  const auto tracker = MakeTestBus(tracker_options), mapper = MakeTestBus(mapper_options);
  ExpectDelivered(tracker.get(), mapper.get(), RandomKeyFrame(2500, &random_));
}

TEST_P(BusSecurityTest, StaticPeersFindEachOther) {
  BusOptions tracker_options = OptionsAmongOthers("frontend_tracker"),
             mapper_options = OptionsAmongOthers("backend_mapper");
  tracker_options.peers = mapper_options.peers = {"localhost"};
  const auto tracker = MakeTestBus(tracker_options), mapper = MakeTestBus(mapper_options);
  ExpectDelivered(tracker.get(), mapper.get(), RandomKeyFrame(100, &random_));
}

TEST_P(BusSecurityTest, LivelinessIsSeen) {
  const auto mapper = Join("backend_mapper"), tool = Join("tool");
  Inbox<int> alive;
  Inbox<ProcessStatus> statuses;
  const auto reader = tool->CreateReader<ProcessStatus>([&](ProcessStatus status) { statuses.Put(std::move(status)); },
                                                        [&](int writers) { alive.Put(writers); });
  const auto writer = mapper->CreateWriter<ProcessStatus>();
  writer->Write(RandomProcessStatus(&random_));
  ASSERT_TRUE(statuses.WaitFor(1));
  // Silent from here on: its lease runs out.
  EXPECT_TRUE(alive.WaitUntilAny([](int writers) { return writers == 1; }));
  EXPECT_TRUE(alive.WaitUntilAny([](int writers) { return writers == 0; }));
}

TEST_P(BusSecurityTest, ATopicWithoutPermissionGetsNoWriterAndNoReader) {
  auto tracker = MakeRawBus(OptionsOf("frontend_tracker"));
  ASSERT_TRUE(tracker.ok());
  const RawTopic delta{Topic<MapDeltaChunk>::kName, Topic<MapDeltaChunk>::kType, false, Topic<MapDeltaChunk>::Qos()};
  const RawTopic request{Topic<SnapshotRequest>::kName, Topic<SnapshotRequest>::kType, false,
                         Topic<SnapshotRequest>::Qos()};
  EXPECT_FALSE((*tracker)->CreateWriter(delta).ok());
  const auto ignore = [](const uint8_t*, size_t) {};
  EXPECT_TRUE((*tracker)->CreateReader(delta, {ignore, nullptr, nullptr}).ok());
  EXPECT_TRUE((*tracker)->CreateWriter(request).ok());
  EXPECT_FALSE((*tracker)->CreateReader(request, {ignore, nullptr, nullptr}).ok());
}

TEST_P(BusSecurityTest, APartitionWithoutPermissionIsToldBeforeAnythingIsMade) {
  BusOptions options = OptionsOf("backend_mapper");
  options.partition = "robot_9";
  EXPECT_THAT(options.Check().error().message, HasSubstr("does not permit partition robot_9"));
}

TEST_P(BusSecurityTest, ThePartitionIsHeldToByDdsItself) {
  // As a program would do it that does not ask before.
  BusOptions options = OptionsOf("backend_mapper");
  options.partition = "robot_9";
  BusSurroundings surroundings;
  surroundings.credentials = Credentials::Open(options.credentials_folder, std::time(nullptr)).value();
  auto mapper = GetParam() == DdsVendor::kFastDds ? MakeFastDdsBus(options, surroundings)
                                                  : MakeCycloneDdsBus(options, surroundings);
  ASSERT_TRUE(mapper.ok());
  const RawTopic delta{Topic<MapDeltaChunk>::kName, Topic<MapDeltaChunk>::kType, false, Topic<MapDeltaChunk>::Qos()};
  EXPECT_FALSE((*mapper)->CreateWriter(delta).ok());
}

/// A deployment, and a stranger in its domain and partition: with no certificate, or one of another authority. (With
/// Cyclone DDS he has to be a process of his own.)
class StrangerTest : public BusSecurityTest {
 protected:
  void ExpectApart(const BusOptions& stranger_options) {
    const auto stranger = MakeTestBus(stranger_options);
    const auto tracker = Join("frontend_tracker"), mapper = Join("backend_mapper");
    Inbox<MapperState> by_tracker;
    Inbox<MapDeltaChunk> by_stranger;
    const auto tracker_reader =
        tracker->CreateReader<MapperState>([&](MapperState state) { by_tracker.Put(std::move(state)); });
    const auto stranger_reader =
        stranger->CreateReader<MapDeltaChunk>([&](MapDeltaChunk chunk) { by_stranger.Put(std::move(chunk)); });
    const auto stranger_writer = stranger->CreateWriter<MapperState>();
    const auto state_writer = mapper->CreateWriter<MapperState>();
    const auto delta_writer = mapper->CreateWriter<MapDeltaChunk>();
    const MapperState true_state = RandomMapperState(&random_), false_state = RandomMapperState(&random_);
    const MapDeltaChunk chunk = RandomDelta(3, &random_);
    // From the true one's arrival on the stranger has had his chance to be discovered, and the same again.
    for (size_t received : {1, 20}) {
      const auto deadline = std::chrono::steady_clock::now() + kTestDeadline;
      while (!by_tracker.WaitFor(received, std::chrono::milliseconds(50)) &&
             std::chrono::steady_clock::now() < deadline) {
        stranger_writer->Write(false_state);
        state_writer->Write(true_state);
        delta_writer->Write(chunk);
      }
    }
    const auto heard = by_tracker.values();
    ASSERT_GE(heard.size(), 20u);
    for (const MapperState& state : heard) EXPECT_TRUE(EncodeSample(ToWire(state)) == EncodeSample(ToWire(true_state)));
    EXPECT_TRUE(by_stranger.values().empty());
    EXPECT_EQ(stranger_writer->MatchedReaders(), 0);
    EXPECT_EQ(stranger_reader->MatchedWriters(), 0);
  }
};

TEST_P(StrangerTest, WithoutACertificateHeSeesAndChangesNothing) {
  ExpectApart(TestOptions(GetParam()));
}

TEST_P(StrangerTest, WithACertificateOfAnotherAuthorityHeSeesAndChangesNothing) {
  const TempFolder folder;
  const TestKeys keys(folder.Path("keys"));
  BusOptions options = TestOptions(GetParam());
  options.credentials_folder = keys.Make("backend_mapper");
  ExpectApart(options);
}

std::string VendorName(const testing::TestParamInfo<DdsVendor>& info) {
  return ToString(info.param);
}
INSTANTIATE_TEST_SUITE_P(Vendors, BusSecurityTest, testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds),
                         VendorName);
INSTANTIATE_TEST_SUITE_P(Vendors, StrangerTest, testing::Values(DdsVendor::kFastDds), VendorName);

}  // namespace
}  // namespace portolan
