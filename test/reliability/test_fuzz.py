#!/usr/bin/env python3
"""Tests of fuzz.sh with stand-ins for the build and the targets."""

import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
# In place of cmake: "builds" the targets.
CMAKE = """#!/usr/bin/env bash
mkdir -p build-fuzz/common/fuzzing
for target in keyframe message; do cp stub build-fuzz/common/fuzzing/portolan_fuzz_$target; done
"""
# In place of a target, whose corpus is its first argument. $FAILS: the one that finds something.
TARGET = """#!/usr/bin/env bash
echo '#2 INITED cov: 12 ft: 13'
echo '#9 DONE cov: 1468 ft: 99'
case "$1" in */$FAILS) printf 'SUMMARY: AddressSanitizer: heap-use-after-free a|b.cc:3\\n'; exit 77 ;; esac
echo 'stat::number_of_executed_units: 1982588'
"""


class FuzzTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        (self.root / "test" / "reliability").mkdir(parents=True)
        shutil.copy(HERE / "fuzz.sh", self.root / "test" / "reliability")
        for path, text in (("launch_scripts/install_dependencies.sh", "#!/bin/sh\n"), ("bin/cmake", CMAKE), ("stub", TARGET)):
            (self.root / path).parent.mkdir(exist_ok=True)
            (self.root / path).write_text(text)
            (self.root / path).chmod(0o755)

    def fuzz(self, *arguments, fails="none"):
        environment = {**os.environ, "PATH": f"{self.root / 'bin'}:{os.environ['PATH']}", "FAILS": fails}
        return subprocess.run([self.root / "test" / "reliability" / "fuzz.sh", *arguments], capture_output=True, text=True, check=False, env=environment)

    def rows(self):
        return self.fuzz("--report").stdout.splitlines()

    def test_the_report_is_a_table_of_the_last_run_of_each_target(self):
        done = self.fuzz("keyframe", "message")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("keyframe: 1982588 inputs, 1468 edges, nothing found", done.stdout)
        self.assertEqual(self.rows(), ["| target | minutes | inputs | edges | found |", "| --- | --- | --- | --- | --- |",
                                       "| keyframe | 0.0 | 1 982 588 | 1468 | nothing |", "| message | 0.0 | 1 982 588 | 1468 | nothing |"])
        (self.root / "build-fuzz" / "message.result").write_text("601\t999\t7\tnothing\n")
        self.assertEqual(self.rows()[3], "| message | 10 | 999 | 7 | nothing |")
        self.assertEqual(len(self.fuzz("--report", "keyframe").stdout.splitlines()), 3)

    def test_what_was_found_stands_in_the_table(self):
        self.assertEqual(self.fuzz("keyframe", "message", fails="message").returncode, 1)
        self.assertEqual(self.rows()[2:], ["| keyframe | 0.0 | 1 982 588 | 1468 | nothing |",
                                           "| message | 0.0 | ? | 1468 | AddressSanitizer: heap-use-after-free a/b.cc:3 |"])

    def test_before_any_run_there_is_nothing_to_report(self):
        done = self.fuzz("--report")
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertIn("no target was run yet", done.stderr)

    def test_unknown_targets_are_refused(self):
        self.assertEqual(self.fuzz("nothing").returncode, 2)


if __name__ == "__main__":
    unittest.main()
