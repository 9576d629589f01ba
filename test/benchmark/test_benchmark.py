#!/usr/bin/env python3
"""Tests of benchmark.py's arithmetic; the runs themselves are what it is for."""

import argparse
import unittest

import benchmark

SUMMARY = {"maps": 1, "keyframes": 40, "frame_ms": {"median": 30.0, "p95": 45.0}, "cpu_s": {"a": 10.0, "b": 20.5}, "peak_memory_mb": {"a": 100, "b": 50}}
EVALUATION = {"tracked": 297, "frames": 300, "joined": {"ate": {"rmse": 1.5}}}


class BenchmarkTest(unittest.TestCase):
    def test_figures_of_a_run(self):
        run = benchmark.figures(SUMMARY, EVALUATION, 20.0)
        self.assertEqual((run["orb_ratio"], run["p95_ratio"], run["cpu_s"], run["memory_mb"], run["ate"]), (1.5, 1.5, 30.5, 150, 1.5))

    def test_row_holds_medians_of_the_runs_that_worked(self):
        runs = [benchmark.figures({**SUMMARY, "maps": maps}, {**EVALUATION, "joined": {"ate": {"rmse": ate}}}, 20.0)
                for maps, ate in ((1, 1.0), (2, 5.0), (2, 2.0))]
        row = benchmark.median_row("kitti_00", [*runs, {"failure": 1}])
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        self.assertEqual(len(cells), len(benchmark.COLUMNS))
        self.assertEqual(cells[:4], ["kitti_00 (1 of 4 runs failed)", "297 of 300 (99.0 %)", "2.0000", "2"])

    def test_row_without_an_ate_or_without_a_run(self):
        run = benchmark.figures(SUMMARY, {**EVALUATION, "joined": {"failure": "too few poses"}}, 20.0)
        self.assertIn("| - |", benchmark.median_row("halls", [run]))
        failed = benchmark.median_row("halls", [{"failure": 1}])
        self.assertEqual(len(failed.strip("|").split("|")), len(benchmark.COLUMNS))

    def test_span_of_frames(self):
        self.assertEqual(benchmark.parse_span("0-246"), (0, 246))
        for text in ("246", "5-2", "a-b", "-3", "1-2-3", ""):
            with self.assertRaises(argparse.ArgumentTypeError):
                benchmark.parse_span(text)


if __name__ == "__main__":
    unittest.main()
