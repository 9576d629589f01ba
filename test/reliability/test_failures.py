#!/usr/bin/env python3
"""Tests of the pure parts of failures.py, and of its command line."""

import contextlib
import io
import pathlib
import tempfile
import unittest

import failures
import failures_plan
from failures_plan import Case


def make_result(**changes):
    result = {"exit_codes": {"frontend_tracker": 0, "atlas_server": 0}, "problems": [], "acknowledged": ["0.a.1", "0.a.2"], "missing": [], "ate": 0.01,
              "tracked": 90, "frames": 100, "maps": 1}
    return {**result, **changes}


CASE = Case(3, 1003, "fastdds", [(2.5, "backend_mapper"), (3.0, "atlas_server")], 2)


class PlanTest(unittest.TestCase):
    def test_sixty_runs_have_every_combination_once(self):
        plan = failures_plan.make_plan(60, 1, (1.0, 9.0))
        combinations = {(frozenset(role for _, role in case.kills), case.delay_s, case.vendor) for case in plan}
        self.assertEqual(len(combinations), 60)
        self.assertEqual([case.number for case in plan], list(range(1, 61)))

    def test_the_same_seed_makes_the_same_runs_and_another_makes_others(self):
        plan = failures_plan.make_plan(70, 1, (1.0, 9.0))
        self.assertEqual(plan, failures_plan.make_plan(70, 1, (1.0, 9.0)))
        self.assertNotEqual(plan, failures_plan.make_plan(70, 2, (1.0, 9.0)))
        self.assertEqual(plan[:5], failures_plan.make_plan(5, 1, (1.0, 9.0)), "a run can be made again alone")

    def test_moments_are_within_the_window(self):
        for case in failures_plan.make_plan(300, 5, (1.0, 9.0)):
            moments = [moment for moment, _ in case.kills]
            self.assertEqual(moments, sorted(moments))
            self.assertGreaterEqual(moments[0], 1.0)
            self.assertLessEqual(moments[-1], 9.0 + failures_plan.MAX_APART_S)
            self.assertEqual(len({role for _, role in case.kills}), len(case.kills))

    def test_some_pairs_die_at_one_moment_and_some_apart(self):
        pairs = [case.kills for case in failures_plan.make_plan(120, 5, (1.0, 9.0)) if len(case.kills) == 2]
        together = sum(kills[0][0] == kills[1][0] for kills in pairs)
        self.assertTrue(0 < together < len(pairs))

    def test_one_vendor_alone(self):
        plan = failures_plan.make_plan(31, 1, (1.0, 9.0), vendors=("cyclonedds",))
        self.assertEqual({case.vendor for case in plan}, {"cyclonedds"})

    def test_a_timeline_is_in_order_and_kills_before_it_starts(self):
        self.assertEqual(failures_plan.timeline(CASE), [(2.5, "kill", "backend_mapper"), (3.0, "kill", "atlas_server"),
                                                        (4.5, "start", "backend_mapper"), (5.0, "start", "atlas_server")])
        self.assertEqual(failures_plan.timeline(CASE._replace(kills=[(2.5, "atlas_server")], delay_s=0)),
                         [(2.5, "kill", "atlas_server"), (2.5, "start", "atlas_server")])


class WitnessTest(unittest.TestCase):
    def test_what_came_and_did_not_go_is_held(self):
        lines = ["delta 0.a.1 1 0 1 +0.a.1 +0.a.2\n", "delta 0.a.1 1 1 2 +0.a.3 -0.a.1\n", "delta 0.a.1 2 0 5 +0.a.2\n"]
        self.assertEqual(failures_plan.read_witness(lines), {"0.a.2", "0.a.3"})

    def test_one_that_comes_again_is_held(self):
        lines = ["delta 0.a.1 1 0 1 +0.a.1", "delta 0.a.1 1 1 2 -0.a.1", "delta 0.a.1 1 2 3 +0.a.1"]
        self.assertEqual(failures_plan.read_witness(lines), {"0.a.1"})

    def test_a_whole_state_that_comes_late_says_nothing_of_now(self):
        lines = ["delta 0.a.1 1 0 1 +0.a.1 +0.a.2", "delta 0.a.1 1 1 2 -0.a.1", "delta 0.a.1 1 0 1 +0.a.1 +0.a.2", "delta 0.a.1 1 2 3 +0.a.3"]
        self.assertEqual(failures_plan.read_witness(lines), {"0.a.2", "0.a.3"})
        self.assertEqual(failures_plan.read_witness([*lines, "delta 0.b.1 1 0 1 +0.b.1", "delta 0.a.1 2 0 1 +0.a.1"]),
                         {"0.a.1", "0.a.2", "0.a.3", "0.b.1"})

    def test_anything_else_is_an_error(self):
        with self.assertRaisesRegex(ValueError, "warning"):
            failures_plan.read_witness(["warning: socket buffers"])


class VerdictTest(unittest.TestCase):
    def test_a_good_run_has_no_reasons(self):
        self.assertEqual(failures_plan.judge(make_result(), 0.012), [])

    def test_each_failure_is_a_reason(self):
        cases = {"ATE": {"ate": 0.02}, "no trajectory": {"ate": None}, "1 keyframes lost": {"missing": ["0.a.2"]},
                 "map 0.a.1 has no root": {"problems": ["map 0.a.1 has no root"]}, "atlas_server ended with code 139": {"exit_codes": {"atlas_server": 139}}}
        for reason, change in cases.items():
            self.assertEqual(failures_plan.judge(make_result(**change), 0.012), [reason])

    def test_the_limit_is_a_fifth_above_the_worst_undisturbed_run(self):
        self.assertAlmostEqual(failures_plan.ate_limit([0.01, 0.02, None]), 0.024)
        self.assertIsNone(failures_plan.ate_limit([None]))

    def test_runs_are_compared_on_the_same_frames(self):
        whole = ["# stamp tx ty tz qx qy qz qw\n", "1.0 0 0 0 0 0 0 1\n", "2.0 1 0 0 0 0 0 1\n", "3.0 2 0 0 0 0 0 1\n"]
        self.assertEqual(failures_plan.same_frames(whole, ["2.0 9 9 9 0 0 0 1\n", "# end\n", "4.0 9 9 9 0 0 0 1\n"]), [whole[2]])

    def test_a_row_says_all_of_a_run(self):
        self.assertEqual(
            failures_plan.row(CASE, make_result(missing=["0.a.2"]), 0.012),
            "| 3 | 1003 | fastdds | backend_mapper 2.5, atlas_server 3.0 | 2 s | 90 of 100 | 1 | 0.0100 | 100 % | 2 | 1 | valid | 1 keyframes lost |")
        self.assertIn("| - | - | 2 | 2 | valid | no trajectory |", failures_plan.row(CASE, make_result(ate=None), None))
        self.assertEqual(failures_plan.row(CASE, make_result(), 1).count("|"), len(failures_plan.COLUMNS) + 1)

    def test_a_summary_counts_the_good_ones(self):
        text = failures_plan.summarize([(CASE, make_result(), 0.012), (CASE, make_result(ate=1.0), 0.012)], {"fastdds": [make_result()]})
        self.assertIn("1 of 2 runs good", text)
        self.assertIn("fastdds: 0.0100 m of 1.", text)
        self.assertEqual(text.count("| 1003 |"), 2)


class CommandLineTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        for name in ("run_witness", "atlas_check", *failures_plan.ROLES):
            (self.folder / f"portolan_{name}").touch()
        (self.folder / "rgb.txt").write_text("# times\n" + "".join(f"{i / 10:.6f} rgb/{i}.png\n" for i in range(401)))
        (self.folder / "groundtruth.txt").touch()

    def parse(self, *arguments):
        return failures.parse(["--bin", str(self.folder), "--out", str(self.folder / "out"), "--data", str(self.folder), *arguments])

    def usage_error(self, *arguments):
        errors = io.StringIO()
        with contextlib.redirect_stderr(errors), self.assertRaises(SystemExit) as ended:
            self.parse(*arguments)
        self.assertEqual(ended.exception.code, failures.EXIT_USAGE)
        return errors.getvalue()

    def test_processes_are_killed_so_early_that_they_come_back_in_time(self):
        options = self.parse("--speed", "0.5", "--max-frames", "201")
        self.assertAlmostEqual(options.duration_s, 40.0)
        self.assertEqual(options.window[0], failures.FIRST_KILL_S)
        self.assertAlmostEqual(options.window[1] + failures_plan.MAX_APART_S + max(failures_plan.DELAYS_S) + failures.AFTER_RESTART_S, 40.0)

    def test_mistakes_are_named(self):
        self.assertIn("expected at least", self.usage_error("--speed", "4"))
        self.assertIn("--speed fast", self.usage_error("--speed", "fast"))
        self.assertIn("--only 61: expected 1 to 60", self.usage_error("--only", "61"))
        (self.folder / "groundtruth.txt").unlink()
        self.assertIn("no ground truth", self.usage_error())
        (self.folder / "portolan_loop_closer").unlink()
        self.assertIn("portolan_loop_closer: no such program", self.usage_error())


if __name__ == "__main__":
    unittest.main()
