#include "transport/cyclonedds_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "transport/cyclonedds_domain.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr int kDomain = 229;  // domains are made and left at once: nothing is sent in them

TEST(CycloneDdsConfigTest, CycloneAcceptsEveryForm) {
  BusOptions options;
  for (const bool small : {false, true}) {
    for (const std::vector<std::string>& peers :
         {std::vector<std::string>{}, std::vector<std::string>{"127.0.0.1", "10.1.2.3"}}) {
      options.small_datagrams = small;
      CycloneDdsDomain domain;
      const Status joined = domain.Join(kDomain, CycloneDdsConfig(options, peers, ""));
      EXPECT_TRUE(joined.ok()) << joined.error().message;
    }
  }
}

TEST(CycloneDdsConfigTest, PeersTurnMulticastOff) {
  const std::string config = CycloneDdsConfig(BusOptions(), {"10.1.2.3"}, "");
  EXPECT_THAT(config, HasSubstr("<AllowMulticast>false"));
  EXPECT_THAT(config, HasSubstr("<Peer Address=\"10.1.2.3\"/>"));
  EXPECT_THAT(CycloneDdsConfig(BusOptions(), {}, ""), Not(HasSubstr("AllowMulticast")));
}

TEST(CycloneDdsConfigTest, TheUsersConfigurationComesLastAndWins) {
  const std::string user = "<General><AllowMulticast>spdp</AllowMulticast></General>";
  EXPECT_THAT(CycloneDdsConfig(BusOptions(), {}, user), testing::EndsWith("," + user));
}

TEST(CycloneDdsDomainTest, ABadConfigurationIsAnErrorAndTheDomainCanBeMadeAfterIt) {
  CycloneDdsDomain bad;
  const Status joined = bad.Join(kDomain, "<NoSuchElement>1</NoSuchElement>");
  ASSERT_FALSE(joined.ok());
  EXPECT_THAT(joined.error().message, HasSubstr("domain 229"));
  CycloneDdsDomain good;
  EXPECT_TRUE(good.Join(kDomain, "").ok());
}

TEST(CycloneDdsDomainTest, SharesOutliveOneAnother) {
  auto first = std::make_unique<CycloneDdsDomain>();
  CycloneDdsDomain second;
  ASSERT_TRUE(first->Join(kDomain, "").ok());
  ASSERT_TRUE(second.Join(kDomain, "").ok());
  first.reset();
  CycloneDdsDomain third;
  EXPECT_TRUE(third.Join(kDomain, "").ok());  // the domain is still there
}

}  // namespace
}  // namespace portolan
