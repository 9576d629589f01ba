#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "transport/bus.h"
#include "transport/raw_bus.h"

namespace portolan {
namespace {

using testing::HasSubstr;

TEST(BusOptionsTest, VendorsAreNamed) {
  EXPECT_EQ(ParseDdsVendor("fastdds").value(), DdsVendor::kFastDds);
  EXPECT_EQ(ParseDdsVendor("cyclonedds").value(), DdsVendor::kCycloneDds);
  EXPECT_THAT(ParseDdsVendor("opendds").error().message, HasSubstr("opendds"));
  for (const DdsVendor vendor : {DdsVendor::kFastDds, DdsVendor::kCycloneDds})
    EXPECT_EQ(ParseDdsVendor(ToString(vendor)).value(), vendor);
}

TEST(BusOptionsTest, DefaultsAreValid) {
  EXPECT_TRUE(BusOptions().Check().ok());
}

TEST(BusOptionsTest, EachFieldIsChecked) {
  BusOptions options;
  for (const int domain : {-1, 231}) {
    options.domain = domain;
    EXPECT_THAT(options.Check().error().message, HasSubstr("dds.domain is " + std::to_string(domain)));
  }
  options = BusOptions();
  for (const std::string partition : {"", "a b", "a<b", "a/b"}) {
    options.partition = partition;
    EXPECT_THAT(options.Check().error().message, HasSubstr("dds.partition is '" + partition + "'"));
  }
  options = BusOptions();
  for (const std::string peer : {"", "a b", "\"/>", "host:7400"}) {
    options.peers = {"10.0.0.1", peer};
    EXPECT_THAT(options.Check().error().message, HasSubstr("dds.peers holds '" + peer + "'"));
  }
  options = BusOptions();
  options.image_topic = "rt::image";
  EXPECT_THAT(options.Check().error().message, HasSubstr("dds.image_topic"));
}

TEST(BusOptionsTest, BadOptionsMakeNoBus) {
  BusOptions options;
  options.domain = 1000;
  EXPECT_THAT(MakeBus(options).error().message, HasSubstr("dds.domain"));
}

TEST(BusOptionsTest, APeerThatCannotBeResolvedIsNamed) {
  BusOptions options;
  options.peers = {"no-such-host.invalid"};  // RFC 2606: never resolves
  EXPECT_THAT(MakeBus(options).error().message, HasSubstr("no-such-host.invalid can't be resolved"));
}

TEST(SampleKeyTest, IsTheFirstMemberBigEndian) {
  const SampleBytes little = {0, 1, 0, 0, 8, 7, 6, 5, 4, 3, 2, 1, 99};
  const SampleBytes big = {0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 99};
  const uint8_t expected[] = {1, 2, 3, 4, 5, 6, 7, 8};
  EXPECT_THAT(KeyOfSample(little.data(), little.size()).bytes, testing::ElementsAreArray(expected));
  EXPECT_THAT(KeyOfSample(big.data(), big.size()).bytes, testing::ElementsAreArray(expected));
}

TEST(SampleKeyTest, IsZeroForASampleTooShort) {
  const SampleBytes bytes = {0, 1, 0, 0, 8, 7, 6, 5, 4, 3, 2};
  EXPECT_THAT(KeyOfSample(bytes.data(), bytes.size()).bytes, testing::Each(0));
  EXPECT_THAT(KeyOfSample(nullptr, 0).bytes, testing::Each(0));
}

}  // namespace
}  // namespace portolan
