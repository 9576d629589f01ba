#pragma once

#include <string>
#include <vector>

#include "base/result.h"
#include "transport/topic_access.h"

namespace portolan {

// Documents of DDS Security (OMG DDS-SECURITY 1.1, Sec. 9.4.1), from the table of topics: what a role may write and
// read there is all that it is permitted. To be signed by the permissions CA.

/// What a grant is limited to.
struct PermissionScope {
  int first_domain = 0, last_domain = 230;
  std::vector<std::string> partitions = {"*"};  ///< names, with the wildcards * and ?
  std::string image_topic = "rt/image";         ///< BusOptions::image_topic

  /// Ranges and characters; the message names the option of portolan_permissions.
  Status Check() const;
};

/// Whom a grant is for, and for how long.
struct Grantee {
  Roles roles = 0;
  std::string subject;                ///< of the certificate, as RFC 2253 has it: "CN=..."
  std::string not_before, not_after;  ///< YYYY-MM-DDThh:mm:ssZ

  Status Check() const;
};

/// @return the role of this name (kRoleNames), or an error that names them all.
Result<Role> ParseRole(const std::string& name);

/// The permissions of one participant, of one role as a rule. What is not in the table is denied.
std::string PermissionsXml(const Grantee& grantee, const PermissionScope& scope);

/// What holds for the whole domain: everybody proves who he is, and everything, discovery included, is encrypted with
/// keys that only the writer and those who may read have.
std::string GovernanceXml(const PermissionScope& scope);

/// The table of topics as Markdown: topic, writers, readers.
std::string AccessTable();

}  // namespace portolan
