"""Tests of atlas_runs.py and map_order.py: what is made of the runs' results."""

import argparse
import contextlib
import io
import json
import pathlib
import subprocess
import tempfile
import unittest

import atlas_runs
import map_order
import sequence_runs

ROBOT = {"cpu_s": {"a": 10.0, "b": 20.5}, "peak_memory_mb": {"a": 100, "b": 50}, "switches": 1, "fusions": 2, "links": 3, "unlinked_maps": 0,
         "frames_to_new_map": [9, 12]}
ATLAS = {"maps": 1, "keyframes": 60, "stored_keyframes": 50, "joins": []}
EVALUATION = {"tracked": 297, "frames": 300, "joined": {"ate": {"rmse": 0.09}}}
MAPS = {"maps": [{"map": 0, "ate": {"rmse": 0.2}}, {"map": 1, "ate": {"rmse": 0.5}}, {"map": 2, "failure": "too few poses"}]}
FOLLOWED = {"poses": 740, "frames": 749, "all_tracked": 1, "order": "1 2 1", "to_new_map": 12}
REST = {"orb_ms": 20.0, "second_pass": None, "kb_per_keyframe": 90}


def join(kind, seconds, done=True):
    return {"kind": kind, "seconds": seconds, "done": done}


class FolderTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)


class MapOrderTest(FolderTest):
    def frames_of(self, name, count, black=None):
        folder = self.folder / name
        folder.mkdir()
        (folder / "rgb.txt").write_text("# head\n" + "".join(f"{i / 10:.6f} x\n" for i in range(count)))
        if black is not None:
            (folder / "source_frames.txt").write_text("".join(f"{i / 10} {'-' if i in black else i}\n" for i in range(count)))
        return map_order.Frames(folder)

    def trajectory(self, maps_by_frame):
        path = self.folder / "trajectory.txt"
        path.write_text("# head\n" + "".join(f"{frame / 10:.6f} 0 0 0 0 0 0 1 {one}\n" for frame, one in maps_by_frame))
        return path

    def test_black_frames_are_those_that_were_put_in_or_are_known(self):
        self.assertEqual(self.frames_of("cut", 20, black={4, 5}).black, {4, 5})
        self.assertEqual(self.frames_of("garden", 20).black, set())
        blackout = self.frames_of("blackout", 761)
        self.assertEqual((min(blackout.black), max(blackout.black), blackout.num_textured()), (247, 258, 749))

    def test_frames_with_texture_are_counted_once(self):
        frames = self.frames_of("cut", 20, black={4, 5})
        self.assertEqual(frames.textured(self.trajectory([(0, 0), (3, 0), (4, 0), (6, 1), (6, 1)])), 3)
        self.assertEqual(frames.textured(self.folder / "none.txt"), 0)

    def test_times_that_are_no_frames_are_passed_over(self):
        frames = self.frames_of("garden", 20)
        self.assertEqual((frames.at(0.3), frames.at(0.3009), frames.at(0.35), frames.at(9.0)), (3, 3, None, None))

    def test_maps_in_the_order_in_which_the_tracker_was_in_them(self):
        frames = self.frames_of("garden", 20)
        path = self.trajectory([(0, 0), (1, 0), (3, 1), (4, 2), (8, 0), (9, 0), (15, 2)])
        visits = frames.visits(path)
        self.assertEqual(visits, [(0, 1), (3, 2), (4, 3), (8, 1), (15, 3)])
        self.assertEqual(map_order.in_words(visits), "1 2 3 1 3")
        self.assertEqual(map_order.in_words([]), "-")
        self.assertEqual(map_order.in_words(frames.visits(path, 5)), "1 3")
        self.assertEqual(map_order.in_words(frames.visits(path, 0, 4)), "1 2 3")

    def test_what_a_second_lap_does(self):
        visits = [(0, 1), (300, 2), (600, 3), (870, 1), (1000, 2)]
        self.assertTrue(map_order.returns_to_first(visits, 865))
        self.assertFalse(map_order.returns_to_first(visits, 900))
        self.assertEqual(map_order.begun_from(visits, 865), set())
        self.assertEqual(map_order.begun_from([*visits, (1100, 4)], 865), {4})
        self.assertFalse(map_order.returns_to_first([], 865))

    def test_black_frames_do_not_count_from_loss_to_a_new_map(self):
        self.assertIsNone(map_order.textured_frames_to_new_map([], 12))
        self.assertEqual(map_order.textured_frames_to_new_map([9, 14], 0), 14)
        self.assertEqual(map_order.textured_frames_to_new_map([115, 14], 110), 14)
        self.assertEqual(map_order.textured_frames_to_new_map([20, 115], 110), 20)
        self.assertEqual(map_order.textured_frames_to_new_map([130], 110), 26)


class AtlasRunsTest(FolderTest):
    def run_of(self, name):
        return atlas_runs.choose([name])[0]

    def cells(self, name, measured):
        return dict(zip(atlas_runs.COLUMNS, atlas_runs.row(self.run_of(name), measured), strict=True))

    def measured(self, summary=None, atlas=None, evaluation=EVALUATION, maps=MAPS, **more):
        return {**atlas_runs.figures({**ROBOT, **(summary or {})}, {**ATLAS, **(atlas or {})}, evaluation, maps), **FOLLOWED, **REST, **more}

    def test_row_holds_medians_beside_the_figures_to_meet(self):
        measured = [self.measured({"switches": n}, {"joins": [join("switch", 0.1), join("switch", 9, False), join("fusion", n)]}) for n in (1, 3, 5)]
        cells = self.cells("blackout", [*measured, {"failure": "x"}])
        for name, cell in {"run": "blackout", "tracked of those with texture": "740 of 749", "joined ATE (m)": "0.090", "worst map's ATE (m)": "0.500",
                           "maps at the end": "1", "links": "3", "unlinked maps": "0", "the tracker's maps": "1 2 1", "switches": "3",
                           "longest switch (s)": "0.10 (≤ 0.3)", "longest fusion (s)": "3.00", "frames to a new map, with texture": "12 (≤ 15)", "keyframes": "60", "2nd pass adds": "-",
                           "kB a keyframe": "90 (≤ 120)", "cv::ORB ms": "20.0", "MB / CPU s by robot": "150 / 30",
                           "verdict": "met; 1 of 4 runs failed"}.items():
            self.assertEqual(cells[name], cell, name)
        self.assertEqual(cells["to meet"], "tracked ≥ 730; fusion or switch on the return; two maps at most; one map or linked ones; joined ATE ≤ 0.1")
        self.assertIn("0.327", cells["ORB-SLAM3"])

    def test_what_is_missed_is_named(self):
        worse = self.measured({"switches": 0, "fusions": 0, "unlinked_maps": 1}, {"maps": 3, "joins": [join("switch", 0.4)]},
                              {"joined": {"failure": "x"}}, poses=729, to_new_map=16, kb_per_keyframe=121)
        missed = ["tracked", "fusion or switch on the return", "two maps at most", "one map or linked ones", "joined ATE", "frames to a new map", "switch",
                  "kB a keyframe"]
        self.assertEqual(self.cells("blackout", [worse])["verdict"], "missed: " + ", ".join(missed))

    def test_most_runs_decide(self):
        one, many = self.measured(poses=1200), self.measured({"unlinked_maps": 1}, {"maps": 2}, poses=1200)
        self.assertNotIn("linked", self.cells("kitchen_cut", [one, one, many])["verdict"])
        self.assertIn("one map or linked ones", self.cells("kitchen_cut", [one, many, many])["verdict"])

    def test_several_robots_are_told_apart_in_memory_and_time(self):
        summary = {"robots": {"robot_0": ROBOT, "robot_1": {**ROBOT, "switches": None, "peak_memory_mb": {"a": 7}}}}
        cells = self.cells("kitchen_halves", [{**atlas_runs.figures(summary, ATLAS, {"joined": {"ate": {"rmse": 0.04}}}, None), **FOLLOWED, **REST}])
        self.assertEqual([cells[name] for name in ("worst map's ATE (m)", "switches", "fusions", "links", "MB / CPU s by robot", "verdict")],
                         ["-", "1", "4", "6", "150 / 30, 7 / 30", "met"])

    def test_lockstep_has_no_time_to_keep(self):
        slow = self.measured(atlas={"joins": [join("switch", 2.0)]}, poses=1000)
        self.assertEqual(self.cells("kitchen_cut", [slow])["longest switch (s)"], "2.00 (≤ 0.3)")
        quarters = {**slow, "memory_mb": [1] * 4, "cpu_s": [1] * 4}
        cells = self.cells("kitchen_quarters", [quarters])
        self.assertEqual((cells["longest switch (s)"], cells["verdict"]), ("2.00", "met"))

    def test_a_run_that_failed_has_a_row(self):
        cells = self.cells("halls", [{"failure": "x"}])
        self.assertEqual((cells["run"], cells["tracked of those with texture"], cells["verdict"]), ("halls", "failed", "1 of 1 runs failed"))

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
        atlas_runs.join_trajectories([self.folder / "a", self.folder / "b", self.folder / "none"], self.folder / "j")
        self.assertEqual((self.folder / "j").read_text(), "0.5 a\n1.0 b\n2.0 a\n10.0 b\n")

    def test_share_of_keyframes_of_the_second_pass(self):
        (self.folder / "rgb.txt").write_text("# head\n" + "".join(f"{i} x\n" for i in range(10)))
        (self.folder / "keyframes.txt").write_text("".join(f"{i} 0\n" for i in (0, 1, 2, 4, 7)))
        self.assertEqual(atlas_runs.second_pass_share(self.folder, self.folder), 0.25)
        (self.folder / "keyframes.txt").write_text("9 0\n")
        self.assertIsNone(atlas_runs.second_pass_share(self.folder, self.folder))

    def test_the_store_is_its_file_and_its_log(self):
        self.assertEqual(atlas_runs.store_bytes(self.folder), 0)
        (self.folder / "atlas.db").write_bytes(bytes(300))
        (self.folder / "atlas.db-wal").write_bytes(bytes(50))
        self.assertEqual(atlas_runs.store_bytes(self.folder), 350)

    def test_every_named_run_is_made_of_known_sequences(self):
        known = {"blackout", "office_walk", "halls", "kitchen", "kitti_00", "town_lap", *atlas_runs.make_sequence.NAMED}
        for run in atlas_runs.RUNS:
            self.assertLessEqual({*run.sequences, run.truth}, known)

    def test_unknown_run_is_named(self):
        with self.assertRaisesRegex(sequence_runs.UsageError, "nowhere"):
            atlas_runs.choose(["nowhere"])

    def town(self, name, frames, maps_by_frame, **more):
        """follow() of a run through the town whose tracker went into the maps at these frames."""
        (self.folder / "times.txt").write_text("".join(f"{i / 10}\n" for i in range(frames)))
        lines, one = [], None
        for frame in range(frames):
            one = maps_by_frame.get(frame, one)
            lines.append(f"{frame / 10:.6f} 0 0 0 0 0 0 1 {one}\n")
        (self.folder / "trajectory_online.txt").write_text("".join(lines))
        return atlas_runs.follow(self.run_of(name), {**ROBOT, "fusions": 0, **more}, [map_order.Frames(self.folder)], [self.folder])

    def test_the_second_lap_through_the_town(self):
        found = self.town("town_lap", 1138, {0: 0, 300: 1, 600: 2, 880: 0, 1100: 1})
        self.assertEqual((found["order"], found["returns"], found["new_in_lap_2"]), ("1 2 3 1 2", 1, 0))
        found = self.town("town_lap", 1138, {0: 0, 300: 1, 600: 2, 880: 3}, fusions=2)
        self.assertEqual((found["returns"], found["new_in_lap_2"]), (0, 3))

    def test_switches_of_two_passes_are_compared(self):
        found = self.town("town_lap_twice", 2276, {0: 0, 300: 1, 880: 0, 1100: 1, 1138: 0, 1440: 1, 2020: 0, 2240: 1})
        self.assertEqual((found["order"], found["same_switches"]), ("1 2 1 2 / 1 2 1 2", 1))
        found = self.town("town_lap_twice", 2276, {0: 0, 300: 1, 880: 0, 1138: 0})
        self.assertEqual((found["order"], found["same_switches"]), ("1 2 1 / 1", 0))

    def measure_two(self, fail=False):
        """kitchen_halves with a stand-in for the programs."""
        data, out = self.folder / "data", self.folder / "out"
        folders = {name: data / name for name in ("kitchen_first_half", "kitchen_second_half", "kitchen")}
        for number, folder in enumerate(folders.values()):
            folder.mkdir(parents=True)
            (folder / "rgb.txt").write_text(f"{number} a.png\n{number + 0.1} b.png\n")
        (data / "kitchen" / "groundtruth.txt").write_text("")

        def run_command(command, _):
            if command[0].name == "portolan_orb_time":
                self.assertEqual(command[1], folders["kitchen_first_half"])
                return "20.5\n"
            if "--robots" in command:
                if fail:
                    raise subprocess.CalledProcessError(3, [str(part) for part in command])
                for number in range(2):
                    (out / f"robot_{number}").mkdir(parents=True)
                    (out / f"robot_{number}" / "trajectory.txt").write_text(f"{number} 0 0 0 0 0 0 1\n")
                    (out / f"robot_{number}" / "trajectory_online.txt").write_text(f"{number} 0 0 0 0 0 0 1 0\n")
                (out / "summary.json").write_text(json.dumps({"robots": {"robot_0": ROBOT, "robot_1": ROBOT}}))
                (out / "atlas_server.json").write_text(json.dumps(ATLAS))
                (out / "atlas.db").write_bytes(bytes(100000))
            else:
                self.assertEqual(len(command[2].read_text().splitlines()), 2)
                command[-1].write_text(json.dumps(EVALUATION))
            return ""

        options = argparse.Namespace(bin=pathlib.Path("/bin"), speed="1")
        return atlas_runs.measure(self.run_of("kitchen_halves"), folders, out, options, [], run_command)

    def test_two_robots_are_compared_in_one_frame(self):
        found = self.measure_two()
        self.assertEqual([found[key] for key in ("poses", "frames", "joined", "order", "all_tracked", "kb_per_keyframe", "orb_ms", "to_new_map")],
                         [2, 4, 0.09, "1, 1", 1, 2, 20.5, 12])

    def test_program_that_fails_is_the_callers_to_note(self):
        with self.assertRaises(subprocess.CalledProcessError), contextlib.redirect_stderr(io.StringIO()):
            self.measure_two(fail=True)


if __name__ == "__main__":
    unittest.main()
