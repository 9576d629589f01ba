#!/usr/bin/env python3
"""Tests of the systemd units, as systemd itself reads them."""

import configparser
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
UNITS = HERE / "systemd"
PREFIX = "/opt/portolan"
ROLES = {"atlas": "atlas_server", "mapper": "backend_mapper", "loop": "loop_closer", "frontend": "frontend_tracker"}
# systemd's own measure, 0 (all is forbidden) to 100 (all is allowed).
MAX_EXPOSURE = 25


def read(unit):
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str
    parser.read(UNITS / unit)
    return parser


@unittest.skipUnless(shutil.which("systemd-analyze"), "systemd-analyze is not installed")
class AnalyzeTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        programs = self.folder / "prefix/bin"
        programs.mkdir(parents=True)
        for unit in UNITS.iterdir():
            text = unit.read_text()
            for program in re.findall(PREFIX + r"/bin/(\S+)", text):
                shutil.copy("/bin/true", programs / program)
            (self.folder / unit.name).write_text(text.replace(PREFIX, str(self.folder / "prefix")))

    def analyze(self, *arguments):
        return subprocess.run(["systemd-analyze", *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False)

    def units(self):
        return sorted(path for path in self.folder.iterdir() if path.suffix in (".service", ".target"))

    def test_systemd_takes_every_line(self):
        ended = self.analyze("verify", "--man=no", *self.units())
        self.assertEqual((ended.returncode, ended.stderr), (0, ""))

    def test_a_mistake_would_be_seen(self):
        unit = self.folder / "portolan-loop.service"
        unit.write_text(unit.read_text().replace("Restart=on-failure", "Restart=perhaps"))
        self.assertNotEqual(self.analyze("verify", "--man=no", unit).stderr, "")

    def test_the_sandbox_is_tight(self):
        for unit in self.units():
            if unit.suffix == ".service":
                ended = self.analyze("security", "--offline=true", f"--threshold={MAX_EXPOSURE}", unit)
                self.assertEqual(ended.returncode, 0, ended.stdout + ended.stderr)


class UnitTest(unittest.TestCase):
    def test_priorities_are_those_of_the_processes(self):
        source = (HERE.parent / "common/process/process_setup.cc").read_text()
        for name, role in ROLES.items():
            nice = re.search(r'{"%s", (-?\d+)}' % role, source).group(1)
            self.assertEqual(read(f"portolan-{name}.service")["Service"]["Nice"], nice, role)

    def test_a_role_that_fails_comes_back_unless_its_configuration_is_bad(self):
        for unit in UNITS.glob("*.service"):
            service = read(unit.name)["Service"]
            self.assertEqual(service["Restart"], "on-failure", unit)
            self.assertIn("2", service["RestartPreventExitStatus"].split(), unit)

    def test_each_role_has_its_program_and_its_own_folder(self):
        for name, role in ROLES.items():
            service = read(f"portolan-{name}.service")["Service"]
            self.assertIn(f"{PREFIX}/bin/portolan_{role} ", service["ExecStart"])
            self.assertEqual(service["StateDirectory"], f"portolan/{role}")


if __name__ == "__main__":
    unittest.main()
