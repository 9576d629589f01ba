#!/usr/bin/env python3
"""Finds includes that break the layers: DDS and what is generated from the IDL stay at the edge, and pure folders don't know of the edge.

usage: layering.py [REPOSITORY]

Each breach is one line, FILE:LINE: what; the exit code is 1 if there is one.
"""

import pathlib
import re
import sys

PACKAGES = ("common", "frontend_tracker", "backend_mapper", "loop_closer", "atlas_server")
SUFFIXES = (".h", ".cc")
# Folders of the edge (docs/architecture.md), below the repository; `process` in each package.
EDGE = ("common/messages", "common/transport", "common/fuzzing")
EDGE_NAME = "process"
# Programs: they may use the edge's own headers, but not what lies behind it.
PROGRAMS = ("common/tools",)

INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^">]+)[">]')
# Headers of the DDS vendors, of CDR, of what is generated, and the one that brings the generated types in.
BEHIND_THE_EDGE = re.compile(r"^(portolan_idl/|fastdds/|fastrtps/|fastcdr/|dds/|ddsc/|messages/wire\.h$|messages/wire_codec\.h$)")
OF_THE_EDGE = re.compile(r"^(transport|messages|process)/")


def place_of(path):
    """'edge', 'program' or 'pure', for a file's path below the repository."""
    folder = path.parent.as_posix()
    if EDGE_NAME in path.parts[1:-1] or any(folder == edge or folder.startswith(edge + "/") for edge in EDGE):
        return "edge"
    return "program" if folder in PROGRAMS else "pure"


def breach_of(header, place):
    """Why a file of this place may not include the header; None if it may."""
    if place == "edge":
        return None
    if BEHIND_THE_EDGE.match(header):
        return "is for common/messages, common/transport and process/ alone"
    if place == "pure" and OF_THE_EDGE.match(header):
        return "is of the DDS edge; this folder is pure"
    return None


def sources(repository):
    for package in PACKAGES:
        yield from sorted(path for path in (repository / package).rglob("*") if path.suffix in SUFFIXES)


def breaches(repository):
    """All of them, as lines."""
    found = []
    for path in sources(repository):
        relative = path.relative_to(repository)
        for number, line in enumerate(path.read_text(errors="replace").split("\n"), start=1):
            include = INCLUDE.match(line)
            reason = breach_of(include.group(1), place_of(relative)) if include else None
            if reason:
                found.append(f"{relative}:{number}: {include.group(1)} {reason}")
    return found


def main(arguments):
    repository = pathlib.Path(arguments[0]) if arguments else pathlib.Path(__file__).resolve().parents[2]
    found = breaches(repository)
    print("\n".join(found) if found else "no include breaks the layers")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
