#include "transport/permissions.h"

#include <algorithm>
#include <cctype>
#include <sstream>
#include <utility>

#include "transport/topics.h"

namespace portolan {
namespace {

struct TopicEntry {
  std::string name;
  TopicAccess access;
  bool in_partition = true;
};

/// All topics, in the order of topics.h.
std::vector<TopicEntry> AllTopics(const std::string& image_topic) {
  std::vector<TopicEntry> topics;
#define PORTOLAN_ADD_TOPIC(T) topics.push_back({Topic<T>::kName, Topic<T>::kAccess, Topic<T>::Qos().in_partition});
  PORTOLAN_FOR_EACH_TOPIC(PORTOLAN_ADD_TOPIC)
#undef PORTOLAN_ADD_TOPIC
  topics.push_back({image_topic, Topic<Image>::kAccess, false});
  topics.push_back({image_topic + Topic<CompressedImage>::kSuffix, Topic<CompressedImage>::kAccess, false});
  return topics;
}

std::string DomainsXml(const PermissionScope& scope) {
  std::ostringstream xml;
  xml << "<domains><id_range><min>" << scope.first_domain << "</min><max>" << scope.last_domain
      << "</max></id_range></domains>\n";
  return xml.str();
}

/// "publish" or "subscribe", of the topics that are in a partition or of those that are in none.
std::string CriterionXml(const std::string& kind, const Grantee& grantee, const PermissionScope& scope,
                         bool in_partition) {
  std::ostringstream xml;
  for (const TopicEntry& topic : AllTopics(scope.image_topic)) {
    const Roles roles = kind == "publish" ? topic.access.writers : topic.access.readers;
    if (topic.in_partition == in_partition && (roles & grantee.roles) != 0)
      xml << "            <topic>" << topic.name << "</topic>\n";
  }
  if (xml.str().empty()) return "";
  std::string partitions;
  if (in_partition) {
    partitions = "          <partitions>\n";
    for (const std::string& partition : scope.partitions)
      partitions += "            <partition>" + partition + "</partition>\n";
    partitions += "          </partitions>\n";
  }
  return "        <" + kind + ">\n          <topics>\n" + xml.str() + "          </topics>\n" + partitions +
         "        </" + kind + ">\n";
}

std::string DocumentXml(const std::string& schema, const std::string& body) {
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<dds xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
         "xsi:noNamespaceSchemaLocation=\"http://www.omg.org/spec/DDS-SECURITY/20170901/" +
         schema + "\">\n" + body + "</dds>\n";
}

std::string NamesOf(Roles roles) {
  std::string names;
  for (const RoleName& entry : kRoleNames) {
    if ((roles & entry.role) != 0) names += (names.empty() ? "" : ", ") + std::string(entry.name);
  }
  return names;
}

bool OnlyHas(const std::string& text, const std::string& others) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [&](unsigned char c) {
    return (c < 128 && std::isalnum(c) != 0) || others.find(static_cast<char>(c)) != std::string::npos;
  });
}

}  // namespace

Status PermissionScope::Check() const {
  if (first_domain < 0 || last_domain > 230 || first_domain > last_domain) {
    return Error{"--domain: " + std::to_string(first_domain) + "-" + std::to_string(last_domain) +
                 ", a domain or a range of them within 0-230 expected"};
  }
  if (partitions.empty()) return Error{"--partition: at least one expected"};
  for (const std::string& partition : partitions) {
    if (!OnlyHas(partition, "_-.*?"))
      return Error{"--partition '" + partition + "': letters, digits, _ - . and the wildcards * ? expected"};
  }
  if (!OnlyHas(image_topic, "_/")) {
    return Error{"--image-topic '" + image_topic + "': a name as rt/camera/image_raw expected"};
  }
  return Ok{};
}

Status Grantee::Check() const {
  // As an X.509 name has it in practice; what XML would take for its own is not among it.
  if (!OnlyHas(subject, "=,._+- "))
    return Error{"--subject '" + subject + "': a name as CN=backend_mapper,O=Portolan expected"};
  for (const auto& [option, time] : {std::pair("--not-before", &not_before), std::pair("--not-after", &not_after)}) {
    if (!OnlyHas(*time, ":-")) return Error{option + (" '" + *time + "': YYYY-MM-DDThh:mm:ssZ expected")};
  }
  return Ok{};
}

Result<Role> ParseRole(const std::string& name) {
  for (const RoleName& entry : kRoleNames) {
    if (name == entry.name) return entry.role;
  }
  return Error{"role '" + name + "' is unknown: one of " + NamesOf(~Roles{0}) + " expected"};
}

std::string PermissionsXml(const Grantee& grantee, const PermissionScope& scope) {
  std::ostringstream xml;
  xml << "  <permissions>\n    <grant name=\"" << NamesOf(grantee.roles) << "\">\n      <subject_name>"
      << grantee.subject << "</subject_name>\n      <validity>\n        <not_before>" << grantee.not_before
      << "</not_before>\n        <not_after>" << grantee.not_after << "</not_after>\n      </validity>\n";
  // Of the topics that are in no partition (images) a rule of their own: a rule's partitions hold for all its topics.
  for (const bool in_partition : {true, false}) {
    const std::string criteria =
        CriterionXml("publish", grantee, scope, in_partition) + CriterionXml("subscribe", grantee, scope, in_partition);
    if (criteria.empty()) continue;
    xml << "      <allow_rule>\n        " << DomainsXml(scope) << criteria << "      </allow_rule>\n";
  }
  xml << "      <default>DENY</default>\n    </grant>\n  </permissions>\n";
  return DocumentXml("omg_shared_ca_permissions.xsd", xml.str());
}

std::string GovernanceXml(const PermissionScope& scope) {
  std::ostringstream xml;
  xml << "  <domain_access_rules>\n    <domain_rule>\n      " << DomainsXml(scope)
      << "      <allow_unauthenticated_participants>false</allow_unauthenticated_participants>\n"
         "      <enable_join_access_control>true</enable_join_access_control>\n"
         "      <discovery_protection_kind>ENCRYPT</discovery_protection_kind>\n"
         "      <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>\n"
         "      <rtps_protection_kind>NONE</rtps_protection_kind>\n"
         "      <topic_access_rules>\n        <topic_rule>\n"
         "          <topic_expression>*</topic_expression>\n"
         "          <enable_discovery_protection>true</enable_discovery_protection>\n"
         "          <enable_liveliness_protection>true</enable_liveliness_protection>\n"
         "          <enable_read_access_control>true</enable_read_access_control>\n"
         "          <enable_write_access_control>true</enable_write_access_control>\n"
         // Whole submessages, each writer and reader with a key of its own: payload, sequence numbers and
         // acknowledgements can be neither read nor forged. Encrypting the payload as well would be a second time.
         "          <metadata_protection_kind>ENCRYPT</metadata_protection_kind>\n"
         "          <data_protection_kind>NONE</data_protection_kind>\n"
         "        </topic_rule>\n      </topic_access_rules>\n    </domain_rule>\n  </domain_access_rules>\n";
  return DocumentXml("omg_shared_ca_governance.xsd", xml.str());
}

std::string AccessTable() {
  std::string table = "| topic | may be written by | may be read by |\n| --- | --- | --- |\n";
  for (const TopicEntry& topic : AllTopics("the image topic")) {
    table += "| " + topic.name + " | " + NamesOf(topic.access.writers) + " | " + NamesOf(topic.access.readers) + " |\n";
  }
  return table;
}

}  // namespace portolan
