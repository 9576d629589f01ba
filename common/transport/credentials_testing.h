#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "base/check.h"
#include "transport/permissions.h"

namespace portolan {

/// Keys as make_keys.py makes them, for tests of the library: an authority in FOLDER/ca and roles beside it.
class TestKeys {
 public:
  explicit TestKeys(std::string folder) : folder_(std::move(folder)) {
    std::filesystem::create_directories(folder_ + "/ca");
    for (const char* name : {"identity_ca", "permissions_ca"}) {
      const std::string path = folder_ + "/ca/" + name;
      Run("req -x509 " + kKey + " -days 100 -subj /CN=" + name + " -keyout " + path + ".key.pem -out " + path +
          ".cert.pem");
    }
  }

  /// @param days negative: expired already. @return the role's folder.
  std::string Make(const std::string& role, const PermissionScope& scope = {}, int days = 10) const {
    return MakeGrant(role, ParseRole(role).value(), scope, days);
  }
  /// Of several roles at once. @param name of the folder, and in the certificate.
  std::string MakeGrant(const std::string& name, Roles roles, const PermissionScope& scope, int days = 10) const {
    const std::string folder = Folder(name), ca = folder_ + "/ca/";
    std::filesystem::create_directories(folder);
    Run("req -new " + kKey + " -subj /CN=" + name + " -keyout " + folder + "/key.pem -out " + folder + "/request.pem");
    Run("x509 -req -in " + folder + "/request.pem -days " + std::to_string(days) + " -CA " + ca +
        "identity_ca.cert.pem -CAkey " + ca + "identity_ca.key.pem -out " + folder + "/cert.pem");
    Grantee grantee;
    grantee.roles = roles;
    grantee.subject = "CN=" + name;
    grantee.not_before = "2020-01-01T00:00:00Z";
    grantee.not_after = "2099-01-01T00:00:00Z";
    Sign(PermissionsXml(grantee, scope), folder + "/permissions.p7s");
    Sign(GovernanceXml(scope), folder + "/governance.p7s");
    for (const char* authority : {"identity_ca", "permissions_ca"})
      std::filesystem::copy(ca + authority + ".cert.pem", folder + "/" + authority + ".cert.pem");
    std::filesystem::permissions(folder + "/key.pem", std::filesystem::perms::owner_read);
    return folder;
  }
  void Sign(const std::string& text, const std::string& file) const {
    const std::string ca = folder_ + "/ca/permissions_ca";
    std::ofstream(file + ".xml") << text;
    Run("smime -sign -text -in " + file + ".xml -out " + file + " -signer " + ca + ".cert.pem -inkey " + ca +
        ".key.pem");
  }
  std::string Folder(const std::string& role) const { return folder_ + "/" + role; }

 private:
  inline static const std::string kKey = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes";

  static void Run(const std::string& arguments) {
    const std::string command = "openssl " + arguments + " 2>/dev/null";
    PORTOLAN_CHECK(std::system(command.c_str()) == 0) << command;
  }

  std::string folder_;
};

}  // namespace portolan
