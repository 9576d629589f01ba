#!/usr/bin/env python3
"""Tests of count_tests.py on results as CTest and GoogleTest write them."""

import contextlib
import io
import pathlib
import tempfile
import unittest

import count_tests

CTEST_ENTRY = """<Test Status="{status}"><Name>{name}</Name><Results>
<NamedMeasurement type="text/string" name="Completion Status"><Value>{how}</Value></NamedMeasurement>
<Measurement><Value>{output}</Value></Measurement></Results></Test>"""
PASSING = '<testcase name="{0}" status="run" result="completed" classname="Suite"/>'
FAILING = '<testcase name="{0}" status="run" result="completed" classname="Suite"><failure message="x.cc:3&#x0A;Expected: 1" type=""/></testcase>'
SKIPPING = '<testcase name="{0}" status="run" result="skipped" classname="Suite"><skipped message="x.cc:9&#x0A;no data"/></testcase>'
DISABLED = '<testcase name="DISABLED_{0}" status="notrun" result="suppressed" classname="Suite"/>'


class CountTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.build = pathlib.Path(folder.name)

    def add_package(self, name, entries, gtest):
        """entries: {CTest entry: (status, how, output)}; gtest: {CTest entry: its <testcase> elements}."""
        testing = self.build / name / "Testing" / "20240101-0000"
        testing.mkdir(parents=True)
        (testing.parent / "TAG").write_text("20240101-0000\nExperimental\n")
        tests = "".join(CTEST_ENTRY.format(name=entry, status=status, how=how, output=output)
                        for entry, (status, how, output) in entries.items())
        names = "".join(f"<Test>./{entry}</Test>" for entry in entries)
        (testing / "Test.xml").write_text(f"<Site><Testing><TestList>{names}</TestList>{tests}</Testing></Site>")
        results = self.build / name / "test_results"
        results.mkdir()
        for entry, cases in gtest.items():
            (results / f"{entry}.xml").write_text(f'<testsuites><testsuite name="Suite">{"".join(cases)}</testsuite></testsuites>')

    def count(self, *arguments):
        """(exit code, last line, everything printed)."""
        with contextlib.redirect_stdout(io.StringIO()) as output:
            code = count_tests.main([str(self.build), *arguments])
        return code, output.getvalue().rstrip("\n").split("\n")[-1], output.getvalue()

    def test_counts_cases_of_all_packages(self):
        self.add_package("a", {"a_test": ("passed", "Completed", "")}, {"a_test": [PASSING.format("X"), PASSING.format("Y")]})
        self.add_package("b", {"b_test": ("passed", "Completed", ""), "script": ("passed", "Completed", "")}, {"b_test": [SKIPPING.format("Z")]})
        (self.build / "without_tests").mkdir()
        code, last, text = self.count()
        self.assertEqual((code, last), (0, "3 passed, 0 failed, 1 skipped"))
        self.assertIn("1 x no data (Suite.Z)", text)

    def test_failures_are_shown(self):
        self.add_package("a", {"a_test": ("failed", "Completed", "")}, {"a_test": [FAILING.format("X"), PASSING.format("Y"), DISABLED.format("W")]})
        code, last, text = self.count()
        self.assertEqual((code, last), (1, "1 passed, 1 failed, 1 skipped"))
        self.assertIn("Suite.X\nx.cc:3\nExpected: 1", text)

    def test_crash_without_results_is_one_failure(self):
        self.add_package("a", {"a_test": ("failed", "SEGFAULT", "last words")}, {})
        code, last, text = self.count()
        self.assertEqual((code, last), (1, "0 passed, 1 failed, 0 skipped"))
        self.assertIn("SEGFAULT\nlast words", text)

    def test_crash_after_all_cases_passed_is_a_failure(self):
        self.add_package("a", {"a_test": ("failed", "Completed", "LeakSanitizer")}, {"a_test": [PASSING.format("X")]})
        self.assertEqual(self.count()[:2], (1, "1 passed, 1 failed, 0 skipped"))

    def test_program_that_was_not_found_is_a_failure(self):
        self.add_package("a", {"a_test": ("notrun", "Unable to find executable", "")}, {})
        self.assertEqual(self.count()[:2], (1, "0 passed, 1 failed, 0 skipped"))

    def test_entry_skipped_by_ctest(self):
        self.add_package("a", {"x": ("notrun", "SKIP_RETURN_CODE=77", ""), "y": ("passed", "Completed", "")}, {})
        self.assertEqual(self.count()[:2], (0, "1 passed, 0 failed, 1 skipped"))

    def test_results_cut_short_are_a_failure(self):
        self.add_package("a", {"a_test": ("passed", "Completed", "")}, {"a_test": []})
        (self.build / "a" / "test_results" / "a_test.xml").write_text("<testsuites><testsu")
        self.assertEqual(self.count()[:2], (1, "0 passed, 1 failed, 0 skipped"))

    def test_nothing_ran_is_a_failure(self):
        self.assertEqual(self.count()[:2], (1, "0 passed, 0 failed, 0 skipped"))
        self.add_package("a", {"a_test": ("passed", "Completed", "")}, {"a_test": [SKIPPING.format("X")]})
        self.assertEqual(self.count()[:2], (1, "0 passed, 0 failed, 1 skipped"))
        self.assertEqual(self.count("--failed", "colcon test ended with code 1")[1], "0 passed, 1 failed, 1 skipped")


if __name__ == "__main__":
    unittest.main()
