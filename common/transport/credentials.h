#pragma once

#include <cstdint>
#include <string>

#include "base/result.h"

namespace portolan {

/// The files with which a participant proves who it is and what it may do (DDS Security), absolute paths in one folder.
/// Names as SROS 2 has them.
struct Credentials {
  std::string identity_ca;     ///< identity_ca.cert.pem: whom this deployment trusts
  std::string certificate;     ///< cert.pem: who the participant is
  std::string private_key;     ///< key.pem
  std::string permissions_ca;  ///< permissions_ca.cert.pem: who may permit
  std::string governance;      ///< governance.p7s: rules of the domain, signed
  std::string permissions;     ///< permissions.p7s: what the participant may write and read, signed
  std::string subject;         ///< of the certificate, RFC 2253
  int64_t expires_s = 0;       ///< when certificate or permissions end, Unix time
  std::string permitted;       ///< what the permissions say, as XML

  /// Looks for all six and checks them as the vendors would, who say less when something is wrong: that each can be
  /// read, is what its name says, holds at `now_s`, and that they belong together. The message names the file.
  /// @param now_s Unix time.
  static Result<Credentials> Open(const std::string& folder, int64_t now_s);

  /// Whether the permissions are for this domain and partition at all: else DDS would make no writer there.
  Status CheckPermitted(int domain, const std::string& partition) const;
};

}  // namespace portolan
