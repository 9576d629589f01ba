#include "transport/credentials.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <ctime>

#include "dataset/temp_folder.h"
#include "transport/credentials_testing.h"

namespace portolan {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr int64_t kHourS = 3600, kDayS = 86400;

class CredentialsTest : public testing::Test {
 protected:
  CredentialsTest() : keys_(folder_.Path("keys")), mapper_(keys_.Make("backend_mapper")) {}

  /// What is said of the mapper's folder after `file` got this content.
  std::string ComplaintWith(const std::string& file, const std::string& content) {
    std::filesystem::permissions(mapper_ + "/" + file, std::filesystem::perms::owner_all);
    std::ofstream(mapper_ + "/" + file) << content;
    return Complaint(now_s_);
  }
  std::string ComplaintWithFileOf(const std::string& file, const std::string& other_folder) {
    std::filesystem::copy(other_folder + "/" + file, mapper_ + "/" + file,
                          std::filesystem::copy_options::overwrite_existing);
    return Complaint(now_s_);
  }
  std::string Complaint(int64_t now_s) const {
    const Result<Credentials> opened = Credentials::Open(mapper_, now_s);
    return opened.ok() ? "" : opened.error().message;
  }

  const int64_t now_s_ = std::time(nullptr) + kHourS;  // when the keys have been made
  TempFolder folder_;
  TestKeys keys_;
  std::string mapper_;
};

TEST_F(CredentialsTest, WhatBelongsTogetherIsTaken) {
  const Result<Credentials> opened = Credentials::Open(mapper_, now_s_);
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  EXPECT_EQ(opened->subject, "CN=backend_mapper");
  EXPECT_EQ(opened->private_key, mapper_ + "/key.pem");
  EXPECT_NEAR(static_cast<double>(opened->expires_s - now_s_), 10.0 * kDayS, 2.0 * kHourS);
}

TEST_F(CredentialsTest, EachFileThatIsMissingOrSpoiledIsNamed) {
  for (const char* file : {"identity_ca.cert.pem", "cert.pem", "key.pem", "permissions_ca.cert.pem", "governance.p7s",
                           "permissions.p7s"}) {
    const std::string path = mapper_ + "/" + file, kept = path + ".kept";
    std::filesystem::rename(path, kept);
    EXPECT_THAT(Complaint(now_s_), AllOf(HasSubstr("dds.security: " + path), HasSubstr("No such file")));
    std::filesystem::create_directory(path);
    EXPECT_THAT(Complaint(now_s_), AllOf(HasSubstr(path), HasSubstr("is a folder")));
    std::filesystem::remove(path);
    std::ofstream(path) << "nothing of the kind\n";
    std::filesystem::permissions(path, std::filesystem::perms::owner_read);
    EXPECT_THAT(Complaint(now_s_), AllOf(HasSubstr(path), HasSubstr("no "))) << file;
    std::filesystem::rename(kept, path);
  }
  EXPECT_EQ(Complaint(now_s_), "");
}

TEST_F(CredentialsTest, AMissingFolderIsNamed) {
  const Result<Credentials> opened = Credentials::Open(keys_.Folder("none"), now_s_);
  ASSERT_FALSE(opened.ok());
  EXPECT_THAT(opened.error().message, AllOf(HasSubstr(keys_.Folder("none")), HasSubstr("make_keys.py")));
}

TEST_F(CredentialsTest, WhatHasExpiredOrDoesNotHoldYetIsNamed) {
  EXPECT_THAT(Complaint(now_s_ + 11 * kDayS), AllOf(HasSubstr("/cert.pem"), HasSubstr("expired on 20")));
  EXPECT_THAT(Complaint(now_s_ + 101 * kDayS), HasSubstr("/identity_ca.cert.pem: the certificate expired"));
  EXPECT_THAT(Complaint(now_s_ - kDayS), HasSubstr("this machine's clock says"));
  Grantee grantee;
  grantee.roles = kRoleMapper;
  grantee.subject = "CN=backend_mapper";
  grantee.not_before = "2020-01-01T00:00:00Z";
  grantee.not_after = "2021-01-01T00:00:00Z";
  keys_.Sign(PermissionsXml(grantee, {}), mapper_ + "/permissions.p7s");
  EXPECT_THAT(Complaint(now_s_), HasSubstr("/permissions.p7s: the permission expired on 2021-01-01"));
}

TEST_F(CredentialsTest, AKeyOfAnotherIsNamed) {
  EXPECT_THAT(ComplaintWithFileOf("key.pem", keys_.Make("tool")), HasSubstr("/key.pem: is not the key of"));
}

TEST_F(CredentialsTest, PermissionsOfAnotherAreNamed) {
  EXPECT_THAT(ComplaintWithFileOf("permissions.p7s", keys_.Make("atlas_server")),
              AllOf(HasSubstr("/permissions.p7s: permits 'CN=atlas_server'"), HasSubstr("'CN=backend_mapper'")));
}

TEST_F(CredentialsTest, DomainsAndPartitionsThatAreNotPermittedAreNamed) {
  PermissionScope scope;
  scope.first_domain = 7;
  scope.last_domain = 9;
  scope.partitions = {"fleet", "robot_1?"};
  const Result<Credentials> opened = Credentials::Open(keys_.Make("frontend_tracker", scope), now_s_);
  ASSERT_TRUE(opened.ok()) << opened.error().message;
  for (const char* partition : {"fleet", "robot_17"}) EXPECT_TRUE(opened->CheckPermitted(7, partition).ok());
  for (const int domain : {6, 10})
    EXPECT_THAT(opened->CheckPermitted(domain, "fleet").error().message, HasSubstr("domain " + std::to_string(domain)));
  for (const char* partition : {"robot_1", "fleets", "*"})
    EXPECT_THAT(opened->CheckPermitted(9, partition).error().message, HasSubstr(std::string("partition ") + partition));
}

TEST_F(CredentialsTest, AForeignAuthorityIsNamed) {
  const std::string foreign = TestKeys(folder_.Path("foreign")).Make("backend_mapper");
  EXPECT_THAT(ComplaintWithFileOf("permissions_ca.cert.pem", foreign), HasSubstr("/governance.p7s: is not signed by"));
  EXPECT_THAT(ComplaintWithFileOf("identity_ca.cert.pem", foreign), HasSubstr("/cert.pem: is not signed by"));
}

TEST_F(CredentialsTest, ADocumentThatWasChangedIsNamed) {
  std::ostringstream text;
  text << std::ifstream(mapper_ + "/permissions.p7s").rdbuf();
  std::string changed = text.str();
  changed.replace(changed.find("DENY"), 4, "ALLW");
  EXPECT_THAT(ComplaintWith("permissions.p7s", changed), HasSubstr("was changed since"));
}

TEST_F(CredentialsTest, AKeyForEverybodyIsRefused) {
  std::filesystem::permissions(mapper_ + "/key.pem", std::filesystem::perms::others_read,
                               std::filesystem::perm_options::add);
  EXPECT_THAT(Complaint(now_s_), HasSubstr("/key.pem: everybody on this machine"));
}

TEST_F(CredentialsTest, AKeyWithAPasswordIsRefusedWithoutAskingForIt) {
  const std::string key = mapper_ + "/key.pem";
  const std::string command =
      "openssl pkey -aes128 -passout pass:secret -in " + key + " -out " + key + ".locked 2>/dev/null";
  ASSERT_EQ(std::system(command.c_str()), 0);
  std::filesystem::rename(key + ".locked", key);
  EXPECT_THAT(Complaint(now_s_), HasSubstr("/key.pem: has a password"));
}

}  // namespace
}  // namespace portolan
