// portolan_permissions: writes the documents of DDS Security that follow from the table of topics; make_keys.py signs
// them.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>

#include "base/command_line.h"
#include "transport/permissions.h"
#include "version/version.h"

namespace portolan {
namespace {

struct Arguments {
  std::string document, domains = "0-230";
  Grantee grantee;
  PermissionScope scope;
};

int Complain(const std::string& message) {
  std::fprintf(stderr, "portolan_permissions: %s\n", message.c_str());
  return kExitUsage;
}

void AddOptions(CLI::App* app, Arguments* arguments) {
  app->add_option("DOCUMENT", arguments->document,
                  "a role, for its permissions: frontend_tracker, backend_mapper, loop_closer, atlas_server, tool or "
                  "camera; or 'governance', for the rules of the domain; or 'table', for all roles' in Markdown")
      ->required();
  app->add_option("--subject", arguments->grantee.subject, "of the role's certificate, as RFC 2253 has it");
  app->add_option("--not-before", arguments->grantee.not_before, "YYYY-MM-DDThh:mm:ssZ");
  app->add_option("--not-after", arguments->grantee.not_after, "YYYY-MM-DDThh:mm:ssZ");
  app->add_option("--domain", arguments->domains, "N, or N-M")->capture_default_str();
  app->add_option("--partition", arguments->scope.partitions, "with wildcards (repeatable)")->capture_default_str();
  app->add_option("--image-topic", arguments->scope.image_topic, "dds.image_topic")->capture_default_str();
}

/// "7" or "7-9".
bool ParseDomains(const std::string& text, PermissionScope* scope) {
  int read = 0;
  const int size = static_cast<int>(text.size());
  if (std::sscanf(text.c_str(), "%d%n-%d%n", &scope->first_domain, &read, &scope->last_domain, &read) == 1)
    scope->last_domain = scope->first_domain;
  return size > 0 && read == size;
}

int Run(Arguments* arguments) {
  if (!ParseDomains(arguments->domains, &arguments->scope))
    return Complain("--domain '" + arguments->domains + "': N or N-M expected");
  if (Status checked = arguments->scope.Check(); !checked) return Complain(checked.error().message);
  if (arguments->document == "governance") return std::fputs(GovernanceXml(arguments->scope).c_str(), stdout) < 0;
  if (arguments->document == "table") return std::fputs(AccessTable().c_str(), stdout) < 0;
  const Result<Role> role = ParseRole(arguments->document);
  if (!role) return Complain(role.error().message);
  arguments->grantee.roles = *role;
  if (Status checked = arguments->grantee.Check(); !checked) return Complain(checked.error().message);
  return std::fputs(PermissionsXml(arguments->grantee, arguments->scope).c_str(), stdout) < 0;
}

int Main(int argc, char** argv) {
  CLI::App app("Writes documents of DDS Security that follow from Portolan's table of topics on standard output.",
               "portolan_permissions");
  app.set_version_flag("--version", "portolan_permissions " + BuildDescription());
  Arguments arguments;
  AddOptions(&app, &arguments);
  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  return Run(&arguments);
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  return portolan::Main(argc, argv);
}
