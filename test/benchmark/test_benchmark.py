#!/usr/bin/env python3
"""Tests of benchmark.py and sequence_runs.py: what is made of a run's figures, and the whole with stand-ins for the programs."""

import argparse
import contextlib
import io
import json
import pathlib
import sys
import tempfile
import unittest
import unittest.mock

import benchmark
import figures_to_meet
import sequence_runs
from figures_to_meet import at_least, at_most

SUMMARY = {
    "frames": 300, "tracked": 298, "maps": 1, "keyframes": 40, "switches": 0, "fusions": 0, "closures": [], "links": 1, "unlinked_maps": 0,
    "frames_to_new_map": [],
    "frame_ms": {"median": 30.0, "p95": 45.0}, "stages_ms": {"frontend_tracker": {"keyframe_to_delta": {"median": 41.0, "p95": 90.0, "count": 40}}},
    "cpu_s": {"frontend_tracker": 10.0, "loop_closer": 20.5}, "peak_memory_mb": {"frontend_tracker": 100, "loop_closer": 50},
}
NEVER = {**SUMMARY, "tracked": 0, "maps": 0, "keyframes": 0, "frame_ms": {"median": None, "p95": None}, "stages_ms": {"frontend_tracker": {}}}
EVALUATION = {"tracked": 297, "frames": 300, "joined": {"ate": {"rmse": 1.5}}}
MAPS = {"maps": [{"map": 0, "poses": 20, "ate": {"rmse": 0.1}}, {"map": 1, "poses": 250, "ate": {"rmse": 0.7}}, {"map": 2, "poses": 5, "failure": "too few"}]}
POSE = "0 0 0 0 0 0 1"


def cells_of(sequence, runs):
    return dict(zip(sequence_runs.COLUMNS, sequence_runs.row(sequence, runs), strict=True))


def named(name):
    return sequence_runs.Sequence(name, pathlib.Path(name), None)


class FiguresTest(unittest.TestCase):
    def test_figures_of_a_run(self):
        run = sequence_runs.figures(SUMMARY, EVALUATION, MAPS, 20.0)
        self.assertEqual((run["orb_ratio"], run["p95_ratio"], run["cpu_s"], run["memory_mb"], run["ate"]), (1.5, 1.5, 30.5, 150, 1.5))
        self.assertEqual((run["keyframe_ms"], run["loop_closer_mb"], run["map_ate"], run["poses"]), (41, 50, 0.7, 297))

    def test_row_holds_medians_of_the_runs_that_worked_beside_the_figures_to_meet(self):
        runs = [sequence_runs.figures({**SUMMARY, "maps": maps}, {**EVALUATION, "joined": {"ate": {"rmse": ate}}}, MAPS, 20.0)
                for maps, ate in ((1, 1.0), (2, 5.0), (2, 1.5))]
        cells = cells_of(named("kitti_00"), [*runs, {"failure": 1}])
        self.assertEqual([cells[name] for name in ("sequence", "tracked", "ATE (m)", "maps")], ["kitti_00", "297 of 300 (≥ 297)", "1.5000 (≤ 1.6)", "2"])
        self.assertEqual([cells[name] for name in ("x ORB", "p95 / median", "keyframe's way (ms)", "CPU s", "MB", "cv::ORB ms")],
                         ["1.50 (≤ 1.5)", "1.50 (≤ 2)", "41 (≤ 60)", "30.5 (≤ 35)", "150 (≤ 700)", "20.0"])
        self.assertEqual(cells["verdict"], "met; 1 of 4 runs failed")

    def test_what_is_missed_is_named(self):
        slow = {**SUMMARY, "frame_ms": {"median": 31.0, "p95": 63.0}, "stages_ms": {"frontend_tracker": {"keyframe_to_delta": {"median": 61.0}}}}
        run = sequence_runs.figures(slow, {**EVALUATION, "tracked": 296}, MAPS, 20.0)
        self.assertEqual(cells_of(named("kitti_00"), [run])["verdict"], "missed: tracked, p95 / median, keyframe's way, x ORB")

    def test_other_sequences_have_nothing_to_meet(self):
        cells = cells_of(named("garden"), [sequence_runs.figures(SUMMARY, EVALUATION, MAPS, 20.0)])
        self.assertEqual((cells["tracked"], cells["verdict"]), ("297 of 300", "-"))

    def test_without_ground_truth_the_tracker_counts_its_frames(self):
        cells = cells_of(named("garden"), [sequence_runs.figures(SUMMARY, None, None, 20.0)])
        self.assertEqual((cells["tracked"], cells["ATE (m)"], cells["largest map's (m)"]), ("298 of 300", "-", "-"))

    def test_a_run_that_never_begins_a_map_has_a_row(self):
        cells = cells_of(named("halls"), [sequence_runs.figures(NEVER, None, None, 20.0)])
        self.assertEqual((cells["tracked"], cells["ATE (m)"], cells["frame ms"], cells["x ORB"]), ("0 of 300 (≥ 1020)", "-", "-", "-"))
        self.assertIn("tracked, ATE in one map", cells["verdict"])

    def test_a_trajectory_too_short_to_align_has_no_ate(self):
        run = sequence_runs.figures(SUMMARY, {**EVALUATION, "joined": {"failure": "too few poses"}}, MAPS, 20.0)
        self.assertEqual(cells_of(named("garden"), [run])["ATE (m)"], "-")

    def test_runs_that_failed_have_a_row(self):
        cells = cells_of(named("halls"), [{"failure": 1}, {"failure": 1}])
        self.assertEqual((cells["tracked"], cells["verdict"]), ("failed", "2 of 2 runs failed"))

    def test_span_of_frames(self):
        self.assertEqual(sequence_runs.parse_span("0-246"), (0, 246))
        for text in ("246", "5-2", "a-b", "-3", "1-2-3", ""):
            with self.assertRaises(argparse.ArgumentTypeError):
                sequence_runs.parse_span(text)

    def test_medians_decide_and_a_figure_that_is_not_there_is_missed_unless_it_may_be(self):
        limits = (at_most("a", "A", 2), at_least("b", "B", 3), at_most("c", "C", 1, is_optional=True))
        self.assertEqual(figures_to_meet.verdict(limits, [{"a": 1, "b": 3}, {"a": 2, "b": 9}, {"a": 9, "b": 0}]), "met")
        self.assertEqual(figures_to_meet.verdict(limits, [{"a": None, "b": 2, "c": 1.5}]), "missed: A, B, C")


class RevisitsTest(unittest.TestCase):
    def closed(self, closures, **more):
        """Of town_lap, whose frames 865 to 1135 see those from 0 to 268; closures: (frame, frame matched, applied)."""
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            (folder / "times.txt").write_text("".join(f"{i / 10}\n" for i in range(1138)))
            entries = [{"stamp_ns": int(a * 1e8), "matched_stamp_ns": int(b * 1e8), "applied": applied} for a, b, applied in closures]
            return sequence_runs.revisits_closed(sequence_runs.Sequence("town_lap", folder, None), {**SUMMARY, "closures": entries, **more})

    def test_a_loop_closes_the_place_it_is_at_and_counts_once(self):
        self.assertEqual(self.closed([]), 0)
        self.assertEqual(self.closed([(900, 35, True), (1000, 140, True)]), 1)

    def test_loops_that_were_not_applied_or_are_elsewhere_do_not_count(self):
        self.assertEqual(self.closed([(900, 35, False), (900, 500, True), (700, 35, True)]), 0)

    def test_where_maps_were_joined_it_is_not_known(self):
        self.assertIsNone(self.closed([(900, 35, True)], fusions=1))


EVAL_STUB = """
import json, pathlib, sys
words = sys.argv[1:]
sys.exit(1) if "evaluation_fails" in words[0] else None
poses = len(pathlib.Path(words[1]).read_text().splitlines())
evaluation = {"tracked": poses, "frames": 4, "joined": {"ate": {"rmse": 0.01}}, "maps": [{"poses": poses, "ate": {"rmse": 0.02}}]}
pathlib.Path(words[words.index("--json") + 1]).write_text(json.dumps(evaluation))
"""
ORB_STUB = "print('20.0')"
RUN_STUB = """
import json, os, pathlib, sys
words = sys.argv[1:]
out, data = (pathlib.Path(words[words.index(option) + 1]) for option in ("--out", "--data"))
(out / "arguments.json").write_text(json.dumps(words))
sys.exit(3) if data.name == "run_fails" else None
never = data.name == "never"
for name in ("trajectory.txt", "trajectory_maps.txt"):
    (out / name).write_text("" if never else "0.0 0 0 0 0 0 0 1\\n0.1 0 0 0 0 0 0 1\\n")
(out / "trajectory_online.txt").write_text("" if never else "0.0 0 0 0 0 0 0 1 0\\n0.1 0 0 0 0 0 0 1 1\\n")
(out / "summary.json").write_text(os.environ["NEVER" if never else "SUMMARY"])
(out / "atlas_server.json").write_text(json.dumps({"maps": 2, "keyframes": 40, "stored_keyframes": 40, "joins": []}))
"""


class ProgramTest(unittest.TestCase):
    """benchmark.py with stand-ins for run.sh, portolan_eval and portolan_orb_time."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        (self.folder / "bin").mkdir()
        for name, text in (("portolan_eval", EVAL_STUB), ("portolan_orb_time", ORB_STUB), ("run.sh", RUN_STUB)):
            path = self.folder / "bin" / name
            path.write_text(f"#!{sys.executable} -B\n{text}")
            path.chmod(0o755)
        environment = unittest.mock.patch.dict("os.environ", {"SUMMARY": json.dumps(SUMMARY), "NEVER": json.dumps(NEVER)})
        for patch in (environment, unittest.mock.patch.object(sequence_runs, "LAUNCHER", self.folder / "bin" / "run.sh")):
            patch.start()
            self.addCleanup(patch.stop)

    def make(self, name, truth=True):
        sequence = self.folder / "data" / name
        sequence.mkdir(parents=True)
        (sequence / "rgb.txt").write_text("0.0 a.png\n0.1 b.png\n")
        if truth:
            (sequence / "groundtruth.txt").write_text(f"0.0 {POSE}\n")

    def run_it(self, *arguments):
        """Exit code, rows as {first cell: {column: cell}}, standard error."""
        with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()) as errors:
            folders = [word for name in ("data", "bin", "out") for word in (f"--{name}", str(self.folder / name))]
            code = benchmark.main([*folders, "--runs", "1", *arguments])
        rows = benchmark.report_table.read(said.getvalue())
        return code, {next(iter(row.values())): row for row in rows}, errors.getvalue()

    def arguments_of(self, *folders):
        return json.loads(self.folder.joinpath("out", *folders, "arguments.json").read_text())

    def test_all_sequences_are_measured_and_blackouts_beginning_by_itself(self):
        for name in ("kitchen", "blackout"):
            self.make(name)
        self.make("unknown", truth=False)
        (self.folder / "data" / "pictures").mkdir()
        code, rows, errors = self.run_it()
        self.assertEqual((code, errors), (0, ""))
        self.assertEqual(list(rows), ["blackout", "blackout, frames 0-246", "kitchen", "unknown"])
        self.assertIn("source.max_frames=247", self.arguments_of("blackout_0-246", "1"))
        self.assertNotIn("source.max_frames=247", self.arguments_of("blackout", "1"))
        self.assertEqual(rows["kitchen"]["tracked"], "2 of 4 (≥ 975)")
        self.assertEqual((rows["unknown"]["tracked"], rows["unknown"]["ATE (m)"]), ("298 of 300", "-"))

    def test_figures_that_are_missed_are_no_failure_but_runs_that_fail_are(self):
        for name in ("never", "run_fails", "evaluation_fails"):
            self.make(name)
        code, rows, _ = self.run_it("--sequences", "never")
        self.assertEqual((code, rows["never"]["tracked"]), (0, "0 of 300"))
        code, rows, errors = self.run_it("--sequences", "never", "run_fails", "evaluation_fails")
        self.assertEqual((code, rows["run_fails"]["tracked"], rows["evaluation_fails"]["tracked"]), (1, "failed", "failed"))
        self.assertRegex(errors, r"run_fails: run.sh ended with code 3, see \S+run_fails/1/benchmark.log")
        self.assertIn("evaluation_fails: portolan_eval ended with code 1", errors)

    def test_the_report_has_a_section_with_machine_and_date_and_keeps_other_rows(self):
        for name in ("kitchen", "halls"):
            self.make(name)
        page = self.folder / "figures.md"
        self.run_it("--sequences", "halls", "--report", str(page))
        page.write_text(page.read_text().replace("2 of 4 (≥ 1020)", "9 of 9"))
        self.run_it("--sequences", "kitchen", "--report", str(page))
        text = page.read_text()
        self.assertTrue(text.startswith("# Figures\n\n<!-- begin: sequences (test/benchmark/benchmark.py) -->\n"))
        self.assertIn(benchmark.report_table.cpu_model(), text)
        rows = benchmark.report_table.read(text)
        self.assertEqual([row["sequence"] for row in rows], ["kitchen", "halls"])
        self.assertEqual(rows[1]["tracked"], "9 of 9")
        self.assertRegex(rows[0]["measured"], r"^20\d\d-\d\d-\d\d, 1 run$")
        self.assertEqual(rows[0]["cv::ORB ms"], "20.0")

    def test_rows_measured_in_another_way_do_not_stay(self):
        for name in ("kitchen", "halls"):
            self.make(name)
        page = self.folder / "figures.md"
        self.run_it("--sequences", "halls", "--report", str(page))
        _, _, errors = self.run_it("--sequences", "kitchen", "--speed", "2", "--report", str(page))
        self.assertEqual([row["sequence"] for row in benchmark.report_table.read(page.read_text())], ["kitchen"])
        self.assertIn("go: halls", errors)

    def test_a_page_with_half_a_section_is_refused_before_anything_runs(self):
        self.make("kitchen")
        page = self.folder / "figures.md"
        page.write_text("<!-- begin: sequences (test/benchmark/benchmark.py) -->\n")
        code, _, errors = self.run_it("--report", str(page))
        self.assertEqual(code, 2)
        self.assertIn("expected the line '<!-- end: sequences", errors)
        self.assertFalse((self.folder / "out").exists())

    def test_wrong_arguments_are_named(self):
        self.make("kitchen")
        for arguments, words in ((("--sequences", "nowhere"), "nowhere: no such sequence"),
                                 (("--atlas", "nowhere"), "--atlas nowhere: expected some of blackout"),
                                 (("--report", "/nowhere/page.md"), "/nowhere/page.md: no such folder")):
            code, _, errors = self.run_it(*arguments)
            self.assertEqual(code, 2)
            self.assertIn(words, errors)

    def test_runs_of_the_atlas_have_a_section_of_their_own(self):
        self.make("halls")
        page = self.folder / "figures.md"
        code, rows, errors = self.run_it("--atlas", "halls", "--report", str(page))
        self.assertEqual((code, errors), (0, ""))
        self.assertEqual([rows["halls"][name] for name in ("tracked of those with texture", "the tracker's maps", "maps at the end", "cv::ORB ms", "verdict")],
                         ["2 of 2", "1 2", "2", "20.0", "missed: tracked"])
        self.assertIn("<!-- begin: atlas (test/benchmark/benchmark.py) -->", page.read_text())
        self.assertEqual(benchmark.report_table.read(page.read_text())[0]["verdict"], "missed: tracked")

    def test_vendors_are_compared_on_the_sequences_named(self):
        self.make("kitchen")
        code, rows, _ = self.run_it("--compare", "kitchen", "--frames", "0-9")
        self.assertEqual(code, 0)
        self.assertEqual(list(rows), [f"kitchen, frames 0-9, {setup}" for setup in ("lockstep", "Fast DDS", "Cyclone DDS", "mapper on Cyclone DDS")])
        self.assertEqual([row["verdict"] for row in rows.values()], ["byte-equal", "met", "met", "met"])
        mixed = self.arguments_of("compare", "kitchen_0-9", "mapper_on_Cyclone_DDS", "1")
        self.assertEqual(mixed[mixed.index("--dds"):][:4], ["--dds", "fastdds", "--dds-mapper", "cyclonedds"])
        for number in "12":
            lockstep = self.arguments_of("compare", "kitchen_0-9", "lockstep", number)
            self.assertEqual(lockstep[lockstep.index("--speed") + 1], "lockstep")


if __name__ == "__main__":
    unittest.main()
