#!/usr/bin/env python3
"""Tests of benchmark.py's arithmetic; the runs themselves are what it is for."""

import argparse
import contextlib
import io
import json
import pathlib
import subprocess
import tempfile
import unittest

import atlas_runs
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


ATLAS = {"maps": 1, "keyframes": 60}
ROBOT = {**SUMMARY, "switches": 1, "fusions": 2}
PER_MAP = {"maps": [{}], "maps_combined": {"rmse": 0.2}}


class AtlasRunsTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def run_of(self, name):
        return atlas_runs.choose([name])[0]

    def cells(self, line):
        return [cell.strip() for cell in line.strip("|\n").split("|")]

    def test_row_holds_medians_beside_the_figures_to_meet(self):
        measured = [atlas_runs.figures({**ROBOT, "switches": n}, ATLAS, EVALUATION, PER_MAP, None) for n in (1, 3, 5)]
        cells = self.cells(atlas_runs.row(self.run_of("blackout"), [*measured, {"failure": "x"}]))
        self.assertEqual(len(cells), len(atlas_runs.COLUMNS))
        self.assertEqual(cells[:10], ["blackout (1 of 4 runs failed)", "297 of 300", "1.500", "0.200", "1", "3", "2", "60", "-", "150 / 30"])
        self.assertIn("730 of 761", cells[10])
        self.assertIn("0.327", cells[11])

    def test_several_robots_are_told_apart_in_memory_and_time(self):
        summary = {"robots": {"robot_0": ROBOT, "robot_1": {**ROBOT, "switches": None, "peak_memory_mb": {"a": 7}}}}
        row = atlas_runs.row(self.run_of("kitchen_halves"), [atlas_runs.figures(summary, ATLAS, EVALUATION, None, None)])
        self.assertEqual(self.cells(row)[3:10], ["-", "1", "1", "4", "60", "-", "150 / 30, 7 / 30"])

    def test_a_run_that_failed_has_a_row(self):
        cells = self.cells(atlas_runs.row(self.run_of("halls"), [{"failure": "x"}]))
        self.assertEqual(len(cells), len(atlas_runs.COLUMNS))
        self.assertEqual(cells[:2], ["halls", "failed"])

    def test_commands_of_one_and_of_two_robots(self):
        folders = {name: pathlib.Path("/d") / name for run in atlas_runs.RUNS for name in run.sequences}
        one = atlas_runs.command_of(self.run_of("town_lap"), folders, "o", "1")
        self.assertEqual(one, ["--out", "o", "--speed", "1", "--data", pathlib.Path("/d/town_lap"), "--set", "tracker.max_map_keyframes=120"])
        two = atlas_runs.command_of(self.run_of("kitchen_even_odd"), folders, "o", "1")
        self.assertEqual(two[-4:], ["--robots", 2, "--start-offset", 5])
        self.assertIn("lockstep", atlas_runs.command_of(self.run_of("kitchen_quarters"), folders, "o", "1"))

    def test_trajectories_are_joined_in_the_order_of_time(self):
        (self.folder / "a").write_text("# head\n0.5 a\n2.0 a\n")
        (self.folder / "b").write_text("1.0 b\n10.0 b\n")
        atlas_runs.join_trajectories([self.folder / "a", self.folder / "b"], self.folder / "j")
        self.assertEqual((self.folder / "j").read_text(), "0.5 a\n1.0 b\n2.0 a\n10.0 b\n")

    def test_share_of_keyframes_of_the_second_pass(self):
        (self.folder / "rgb.txt").write_text("# head\n" + "".join(f"{i} x\n" for i in range(10)))
        (self.folder / "keyframes.txt").write_text("".join(f"{i} 0\n" for i in (0, 1, 2, 4, 7)))
        self.assertEqual(atlas_runs.second_pass_share(self.folder, self.folder), 0.25)
        (self.folder / "keyframes.txt").write_text("9 0\n")
        self.assertIsNone(atlas_runs.second_pass_share(self.folder, self.folder))

    def test_every_named_run_is_made_of_known_sequences(self):
        known = {"blackout", "office_walk", "halls", "kitchen", "kitti_00", "town_lap", *atlas_runs.make_sequence.NAMED}
        for run in atlas_runs.RUNS:
            self.assertLessEqual({*run.sequences, run.truth}, known)

    def test_unknown_run_ends_the_program(self):
        with self.assertRaises(SystemExit) as caught:
            atlas_runs.choose(["nowhere"])
        self.assertIn("nowhere", str(caught.exception))

    def measure_two(self, fail=False):
        """kitchen_halves with a stand-in for the programs."""
        data, out = self.folder / "data", self.folder / "out"
        folders = {name: data / name for name in ("kitchen_first_half", "kitchen_second_half", "kitchen")}
        (data / "kitchen").mkdir(parents=True)
        (data / "kitchen" / "groundtruth.txt").write_text("")

        def run_command(command, _):
            if "--robots" in command:
                if fail:
                    raise subprocess.CalledProcessError(3, [str(part) for part in command])
                for number in range(2):
                    (out / f"robot_{number}").mkdir(parents=True)
                    (out / f"robot_{number}" / "trajectory.txt").write_text(f"{number} 0 0 0 0 0 0 1\n")
                (out / "summary.json").write_text(json.dumps({"robots": {"robot_0": ROBOT, "robot_1": ROBOT}}))
                (out / "atlas_server.json").write_text(json.dumps(ATLAS))
            else:
                command[-1].write_text(json.dumps({**EVALUATION, "tracked": len(command[2].read_text().splitlines())}))

        options = argparse.Namespace(bin=pathlib.Path("/bin"), speed="1", launcher="run.sh")
        return atlas_runs.measure(self.run_of("kitchen_halves"), folders, out, options, [], run_command)

    def test_two_robots_are_compared_in_one_frame(self):
        self.assertEqual(self.measure_two()["poses"], 2)

    def test_program_that_fails_is_the_callers_to_note(self):
        with self.assertRaises(subprocess.CalledProcessError), contextlib.redirect_stderr(io.StringIO()):
            self.measure_two(fail=True)


if __name__ == "__main__":
    unittest.main()
