#include "transport/cyclonedds_qos.h"

#include <dlfcn.h>

#include <filesystem>
#include <map>
#include <utility>

namespace portolan {
namespace {

/// The policies that writers and readers share.
CycloneDdsQos MakeCommon(const TopicQos& qos) {
  CycloneDdsQos made(dds_create_qos());
  dds_qset_reliability(made.get(), qos.reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_MSECS(qos.max_blocking_ms));
  dds_qset_durability(made.get(), qos.transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(made.get(), qos.keep_all ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST, qos.depth);
  dds_qset_resource_limits(made.get(), qos.max_samples, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  if (qos.liveliness_lease_ms > 0) {
    dds_qset_liveliness(made.get(), DDS_LIVELINESS_MANUAL_BY_TOPIC, DDS_MSECS(qos.liveliness_lease_ms));
  }
  return made;
}

/// A plugin of DDS Security: in the library's own folder, or as Debian has it, in one below.
Result<std::string> FindPlugin(const std::string& name) {
  Dl_info library{};
  if (dladdr(reinterpret_cast<const void*>(&dds_create_participant), &library) == 0 || library.dli_fname == nullptr)
    return Error{"Cyclone DDS's library can't be found, nor its security plugins"};
  const std::filesystem::path folder = std::filesystem::absolute(library.dli_fname).parent_path();
  for (const std::filesystem::path& place : {folder / "libddsc0debian" / name, folder / name}) {
    if (std::filesystem::exists(place)) return place.string();
  }
  return Error{"Cyclone DDS's security plugin " + name + " is not in " + folder.string() +
               " or libddsc0debian below it"};
}

}  // namespace

Result<CycloneDdsQos> MakeCycloneDdsParticipantQos(const std::optional<Credentials>& credentials) {
  CycloneDdsQos made(dds_create_qos());
  if (!credentials) return Result<CycloneDdsQos>(std::move(made));
  std::map<std::string, std::string> properties = {
      {"dds.sec.auth.identity_ca", "file:" + credentials->identity_ca},
      {"dds.sec.auth.identity_certificate", "file:" + credentials->certificate},
      {"dds.sec.auth.private_key", "file:" + credentials->private_key},
      {"dds.sec.access.permissions_ca", "file:" + credentials->permissions_ca},
      {"dds.sec.access.governance", "file:" + credentials->governance},
      {"dds.sec.access.permissions", "file:" + credentials->permissions}};
  struct Plugin {
    const char *kind, *file, *functions;
  };
  for (const Plugin& plugin : {Plugin{"auth", "libdds_security_auth.so", "authentication"},
                               Plugin{"access", "libdds_security_ac.so", "access_control"},
                               Plugin{"crypto", "libdds_security_crypto.so", "crypto"}}) {
    const Result<std::string> path = FindPlugin(plugin.file);
    if (!path.ok()) return path.error();
    const std::string prefix = std::string("dds.sec.") + plugin.kind + ".library.";
    properties[prefix + "path"] = *path;
    properties[prefix + "init"] = std::string("init_") + plugin.functions;
    properties[prefix + "finalize"] = std::string("finalize_") + plugin.functions;
  }
  for (const auto& [name, value] : properties) dds_qset_prop(made.get(), name.c_str(), value.c_str());
  return Result<CycloneDdsQos>(std::move(made));
}

CycloneDdsQos MakeCycloneDdsWriterQos(const TopicQos& qos) {
  CycloneDdsQos made = MakeCommon(qos);
  if (qos.transient_local) {
    dds_qset_durability_service(made.get(), 0, qos.keep_all ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST, qos.depth,
                                qos.max_samples, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  }
  dds_qset_writer_data_lifecycle(made.get(), false);  // a writer that ends takes nothing back
  return made;
}

CycloneDdsQos MakeCycloneDdsReaderQos(const TopicQos& qos) {
  return MakeCommon(qos);
}

CycloneDdsQos MakeCycloneDdsGroupQos(const std::string& partition) {
  CycloneDdsQos made(dds_create_qos());
  if (!partition.empty()) dds_qset_partition1(made.get(), partition.c_str());
  return made;
}

}  // namespace portolan
