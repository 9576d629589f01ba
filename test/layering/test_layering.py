#!/usr/bin/env python3
"""The repository keeps its layers, and the check would notice if it did not."""

import pathlib
import tempfile
import unittest

import layering

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]


class RepositoryTest(unittest.TestCase):
    def test_no_include_breaks_the_layers(self):
        self.assertEqual(layering.breaches(REPOSITORY), [])

    def test_all_packages_are_looked_at(self):
        looked_at = {path.relative_to(REPOSITORY).parts[0] for path in layering.sources(REPOSITORY)}
        self.assertEqual(looked_at, set(layering.PACKAGES))

    def test_edge_does_include_dds(self):
        # Were the names of the headers to change, the check above would pass without looking at anything.
        headers = [include.group(1) for path in (REPOSITORY / "common").rglob("*") if path.suffix in layering.SUFFIXES
                   for include in map(layering.INCLUDE.match, path.read_text().split("\n")) if include]
        for prefix in ("portolan_idl/", "fastdds/", "fastcdr/", "dds/", "messages/wire.h", "transport/", "process/"):
            self.assertTrue(any(header.startswith(prefix) for header in headers), prefix)


class BreachTest(unittest.TestCase):
    def breaches_of(self, path, text):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / path
            file.parent.mkdir(parents=True)
            file.write_text(text)
            return layering.breaches(pathlib.Path(folder))

    def test_pure_folder_with_dds_is_named_with_its_line(self):
        found = self.breaches_of("common/map/map.cc", '#include "map/map.h"\n\n#include <fastdds/dds/topic/Topic.hpp>\n')
        self.assertEqual(len(found), 1)
        self.assertTrue(found[0].startswith("common/map/map.cc:3: fastdds/dds/topic/Topic.hpp"), found)

    def test_pure_folders_do_not_know_the_edge(self):
        for path in ("common/map/a.h", "frontend_tracker/tracking/a.cc", "atlas_server/atlas/a_test.cc"):
            for header in ("transport/bus.h", "messages/wire.h", "messages/limits.h", "process/process_setup.h", "portolan_idl/status.h", "dds/dds.h"):
                self.assertEqual(len(self.breaches_of(path, f'  # include "{header}"\n')), 1, (path, header))

    def test_programs_use_the_edge_but_not_what_is_behind_it(self):
        self.assertEqual(self.breaches_of("common/tools/play.cc", '#include "transport/bus.h"\n'), [])
        self.assertEqual(len(self.breaches_of("common/tools/play.cc", '#include "messages/wire.h"\n')), 1)

    def test_edge_may(self):
        for path in ("common/messages/a.cc", "common/transport/a.cc", "common/process/a.cc", "loop_closer/process/a.cc"):
            self.assertEqual(self.breaches_of(path, '#include <fastcdr/Cdr.h>\n#include "messages/wire.h"\n#include "process/x.h"\n'), [], path)

    def test_what_is_no_dds_is_allowed(self):
        text = '#include "features/feature_quantization.h"\n#include "map/protocol.h"\n// #include "transport/bus.h"\n#include <vector>\n'
        self.assertEqual(self.breaches_of("frontend_tracker/tracking/a.cc", text), [])


if __name__ == "__main__":
    unittest.main()
