#pragma once

#include <string>

namespace portolan {

/// What a program was built from: Portolan's version, the commit where the sources were a git repository, the kind of
/// build: "0.1.0 428c638a01b2 RelWithDebInfo".
std::string BuildDescription();

}  // namespace portolan
