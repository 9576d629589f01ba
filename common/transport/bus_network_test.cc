#include <gtest/gtest.h>

#include "messages/random_messages.h"
#include "messages/wire_codec.h"
#include "transport/bus_testing.h"
#include "transport/topics.h"

// The settings for networks without multicast and for lossy links, on any pair of vendors. Here they only run over the
// loopback.

namespace portolan {
namespace {

using VendorPair = std::tuple<DdsVendor, DdsVendor>;

class BusNetworkTest : public testing::TestWithParam<VendorPair> {
 protected:
  /// A keyframe of 100 KB and, back, a request.
  void ExpectBothWays(const BusOptions& first_options, const BusOptions& second_options) {
    const std::unique_ptr<Bus> first = MakeTestBus(first_options);
    const std::unique_ptr<Bus> second = MakeTestBus(second_options);
    ExpectDelivered(first.get(), second.get(), RandomKeyFrame(2500, &random_));
    ExpectDelivered(second.get(), first.get(), RandomRequest(&random_));
  }

  template <class T>
  void ExpectDelivered(Bus* writing, Bus* reading, const T& message) {
    Inbox<T> inbox;
    const auto reader = reading->CreateReader<T>([&](T received) { inbox.Put(std::move(received)); });
    const auto writer = writing->CreateWriter<T>();
    ASSERT_TRUE(PublishUntilReceived(writer.get(), message, &inbox));
    EXPECT_TRUE(EncodeSample(ToWire(inbox.values().front())) == EncodeSample(ToWire(message)));
  }

  Random random_{13};
};

TEST_P(BusNetworkTest, SmallDatagramsCarryLargeMessages) {
  BusOptions first = TestOptions(std::get<0>(GetParam())), second = TestOptions(std::get<1>(GetParam()));
  first.small_datagrams = second.small_datagrams = true;
  ExpectBothWays(first, second);
}

TEST_P(BusNetworkTest, StaticPeersFindEachOther) {
  BusOptions first = TestOptions(std::get<0>(GetParam())), second = TestOptions(std::get<1>(GetParam()));
  first.peers = second.peers = {"localhost"};
  ExpectBothWays(first, second);
}

/// Users name the other machines; processes of one machine have to find each other all the same.
TEST_P(BusNetworkTest, ThisMachineNeedsNoNaming) {
  BusOptions first = TestOptions(std::get<0>(GetParam())), second = TestOptions(std::get<1>(GetParam()));
  first.peers = second.peers = {"192.0.2.1"};  // RFC 5737: nobody's
  ExpectBothWays(first, second);
}

std::string PairName(const testing::TestParamInfo<VendorPair>& info) {
  return ToString(std::get<0>(info.param)) + "_to_" + ToString(std::get<1>(info.param));
}

INSTANTIATE_TEST_SUITE_P(Vendors, BusNetworkTest,
                         testing::Combine(testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds),
                                          testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds)),
                         PairName);

}  // namespace
}  // namespace portolan
