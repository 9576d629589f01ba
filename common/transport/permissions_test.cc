#include "transport/permissions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "transport/topics.h"

namespace portolan {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

std::string PermissionsOf(Role role, const PermissionScope& scope = {}) {
  Grantee grantee;
  grantee.roles = role;
  grantee.subject = "CN=test";
  grantee.not_before = "2026-01-01T00:00:00Z";
  grantee.not_after = "2027-01-01T00:00:00Z";
  return PermissionsXml(grantee, scope);
}

/// What stands between two marks, all of it joined.
std::string Within(const std::string& text, const std::string& begin, const std::string& end) {
  std::string found;
  for (size_t at = 0; (at = text.find(begin, at)) != std::string::npos; ++at)
    found += text.substr(at, text.find(end, at) - at);
  return found;
}
std::string Published(const std::string& xml) {
  return Within(xml, "<publish>", "</publish>");
}
std::string Subscribed(const std::string& xml) {
  return Within(xml, "<subscribe>", "</subscribe>");
}
std::string Element(const std::string& topic) {
  return "<topic>" + topic + "</topic>";
}

/// @return whether a role is permitted exactly what the topic's own line says.
template <class T>
bool IsPermittedAsInTheTable() {
  bool all = true;
  for (const RoleName& entry : kRoleNames) {
    const std::string xml = PermissionsOf(entry.role), topic = Element(Topic<T>::kName);
    all &= (Published(xml).find(topic) != std::string::npos) == ((Topic<T>::kAccess.writers & entry.role) != 0);
    all &= (Subscribed(xml).find(topic) != std::string::npos) == ((Topic<T>::kAccess.readers & entry.role) != 0);
  }
  return all;
}

TEST(PermissionsTest, FollowTheTableOfTopics) {
#define PORTOLAN_EXPECT_TOPIC(T) EXPECT_TRUE(IsPermittedAsInTheTable<T>()) << Topic<T>::kName;
  PORTOLAN_FOR_EACH_TOPIC(PORTOLAN_EXPECT_TOPIC)
#undef PORTOLAN_EXPECT_TOPIC
}

TEST(PermissionsTest, OnlyAMapsOwnerAndTheAtlasServerWriteMaps) {
  for (const RoleName& entry : kRoleNames) {
    const bool may_write = entry.role == kRoleMapper || entry.role == kRoleAtlas;
    EXPECT_EQ(Published(PermissionsOf(entry.role)).find(Element("map_delta")) != std::string::npos, may_write)
        << entry.name;
  }
  EXPECT_THAT(Published(PermissionsOf(kRoleTool)),
              AllOf(HasSubstr(Element("request")), Not(HasSubstr(Element("command")))));
}

TEST(PermissionsTest, WhatIsNotInTheTableIsDenied) {
  for (const RoleName& entry : kRoleNames) {
    EXPECT_THAT(PermissionsOf(entry.role), AllOf(HasSubstr("<default>DENY</default>"), Not(HasSubstr(Element("*")))));
  }
}

TEST(PermissionsTest, ImagesAreInNoPartitionAndHaveTheConfiguredName) {
  PermissionScope scope;
  scope.image_topic = "rt/eye";
  scope.partitions = {"robot_3"};
  const std::string camera = PermissionsOf(kRoleCamera, scope);
  EXPECT_THAT(Published(camera), AllOf(HasSubstr(Element("rt/eye")), HasSubstr(Element("rt/eye/compressed"))));
  EXPECT_THAT(camera, Not(HasSubstr("<partition>")));
  const std::string tracker = PermissionsOf(kRoleTracker, scope);
  const std::string last_rule = tracker.substr(tracker.rfind("<allow_rule>"));
  EXPECT_THAT(last_rule, AllOf(HasSubstr(Element("rt/eye")), Not(HasSubstr("<partition>"))));
}

TEST(PermissionsTest, ScopeIsWrittenDown) {
  PermissionScope scope;
  scope.first_domain = 7;
  scope.last_domain = 9;
  scope.partitions = {"robot_3", "fleet"};
  const std::string xml = PermissionsOf(kRoleMapper, scope);
  EXPECT_THAT(xml, AllOf(HasSubstr("<min>7</min><max>9</max>"), HasSubstr("<partition>robot_3</partition>"),
                         HasSubstr("<partition>fleet</partition>"), Not(HasSubstr("<partition>*"))));
  EXPECT_THAT(GovernanceXml(scope), HasSubstr("<min>7</min><max>9</max>"));
}

TEST(PermissionsTest, BadScopesAndNamesAreRefused) {
  PermissionScope scope;
  scope.last_domain = 231;
  EXPECT_THAT(scope.Check().error().message, HasSubstr("--domain: 0-231"));
  scope = PermissionScope();
  scope.partitions = {"a<b"};
  EXPECT_THAT(scope.Check().error().message, HasSubstr("--partition 'a<b'"));
  scope = PermissionScope();
  scope.image_topic = "";
  EXPECT_THAT(scope.Check().error().message, HasSubstr("--image-topic"));
  Grantee grantee;
  grantee.subject = "CN=<b>";
  EXPECT_THAT(grantee.Check().error().message, HasSubstr("--subject 'CN=<b>'"));
  EXPECT_THAT(ParseRole("mapper").error().message, AllOf(HasSubstr("'mapper'"), HasSubstr("backend_mapper")));
}

TEST(PermissionsTest, TheDocumentedTableIsThisOne) {
  std::ostringstream page;
  page << std::ifstream(PORTOLAN_SECURITY_PAGE).rdbuf();
  EXPECT_THAT(page.str(), HasSubstr(AccessTable())) << "docs/security.md has another table than topics.h; "
                                                       "portolan_permissions table prints it";
}

}  // namespace
}  // namespace portolan
