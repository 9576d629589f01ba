#!/usr/bin/env python3
"""Tests of make_sequence.py on small made-up sequences."""

import contextlib
import io
import math
import pathlib
import tempfile
import unittest

import make_sequence
from make_sequence import SequenceError


class SequenceTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.out = self.folder / "out"
        self.tum = self.make_tum(10)

    def make_tum(self, count):
        source = self.folder / "tum"
        (source / "rgb").mkdir(parents=True)
        for i in range(count):
            (source / "rgb" / f"{i}.png").write_bytes(make_sequence.black_png(4 + i % 2, 3))
        (source / "rgb.txt").write_text("# comment\n" + "".join(f"{i / 10 + 5:.6f} rgb/{i}.png\n" for i in range(count)))
        (source / "groundtruth.txt").write_text("".join(f"{i / 10 + 5.01:.6f} {i} 0 0 0 0 0 1\n" for i in range(count)))
        (source / "camera.yaml").write_text("model: pinhole\n")
        return source

    def make_kitti(self, poses):
        source = self.folder / "kitti"
        (source / "image_0").mkdir(parents=True)
        for i in range(len(poses)):
            (source / "image_0" / f"{i:06}.png").write_bytes(make_sequence.black_png(4, 3))
        (source / "times.txt").write_text("".join(f"{i / 10:.6f}\n" for i in range(len(poses))))
        (source / "poses.txt").write_text("".join(pose + "\n" for pose in poses))
        (source / "calib.txt").write_text("P0: 1 0 2 0 0 1 2 0 0 0 1 0\n")
        return source

    def make(self, parts, source=None):
        make_sequence.make(source or self.tum, self.out, parts, force=True)
        rows = [line.split() for line in (self.out / "rgb.txt").read_text().splitlines()[1:]]
        frames = [line.split()[1] for line in (self.out / "source_frames.txt").read_text().splitlines()]
        truth = [line.split() for line in (self.out / "groundtruth.txt").read_text().splitlines()[1:]]
        times = [float(row[0]) for row in rows]
        self.assertTrue(all(a < b for a, b in zip(times, times[1:])), times)
        for row, frame in zip(rows, frames):
            self.assertTrue((self.out / row[1]).is_file())
            if frame != "-":
                self.assertEqual((self.out / row[1]).resolve(), self.image_of(source or self.tum, int(frame)))
        self.assertEqual([pose[0] for pose in truth], [row[0] for row, frame in zip(rows, frames) if frame != "-"])
        return times, frames, truth

    @staticmethod
    def image_of(source, frame):
        return (source / (f"rgb/{frame}.png" if source.name == "tum" else f"image_0/{frame:06}.png")).resolve()

    def assert_fails(self, text, parts="all", source=None):
        with self.assertRaises(SequenceError) as caught:
            make_sequence.make(source or self.tum, self.out, parts)
        self.assertIn(text, str(caught.exception))


class PartsTest(SequenceTest):
    def test_one_piece_keeps_its_times(self):
        times, frames, truth = self.make("2-5")
        self.assertEqual(times, [5.2, 5.3, 5.4, 5.5])
        self.assertEqual(frames, ["2", "3", "4", "5"])
        self.assertEqual([pose[1] for pose in truth], ["2", "3", "4", "5"])

    def test_even_and_odd_frames_share_out_all_of_them(self):
        even, odd = self.make("all/2"), self.make("1-last/2")
        self.assertEqual(sorted(even[0] + odd[0]), [round(5 + i / 10, 6) for i in range(10)])
        self.assertEqual(odd[1], ["1", "3", "5", "7", "9"])

    def test_double_speed_has_the_sources_rate(self):
        times, frames, _ = self.make("all@2")
        self.assertEqual(frames, ["0", "2", "4", "6", "8"])
        self.assertAlmostEqual(times[-1] - times[0], 0.4, places=5)

    def test_cut_with_black_frames(self):
        times, frames, truth = self.make("0-3,black:3,2-9")
        self.assertEqual(frames, ["0", "1", "2", "3", "-", "-", "-", *"23456789"])
        self.assertAlmostEqual(times[-1], 1.4, places=5)
        self.assertEqual(len(truth), 12)
        black = self.out / "rgb" / "000005.png"
        self.assertEqual(make_sequence.image_size(black), (4, 3))

    def test_forward_and_backward(self):
        _, frames, truth = self.make("7-last,last-7")
        self.assertEqual(frames, ["7", "8", "9", "9", "8", "7"])
        self.assertEqual([pose[1] for pose in truth], frames)

    def test_twice_over(self):
        times, frames, _ = self.make("all,all")
        self.assertEqual(frames, [str(i) for i in range(10)] * 2)
        self.assertAlmostEqual(times[-1], 1.9, places=5)

    def test_wrong_parts_are_named(self):
        for parts, text in (("0-10", "last one is 9"), ("a-b", "'a' is no frame"), ("5", "FIRST-LAST"), ("", "FIRST-LAST"), ("black:0", "black:"),
                            ("black:x", "black:"), ("all/0", "above 0"), ("all@x", "above 0"), ("0-3,", "FIRST-LAST"), ("-3", "is no frame")):
            self.assert_fails(text, parts)
            self.assertFalse(self.out.exists(), parts)


class SourceTest(SequenceTest):
    def test_kitti_poses_become_quaternions(self):
        c, s = math.cos(2.5), math.sin(2.5)
        source = self.make_kitti(["1 0 0 1 0 1 0 2 0 0 1 3", f"{c} 0 {s} 4 0 1 0 5 {-s} 0 {c} 6", "-1 0 0 0 0 -1 0 0 0 0 1 0"])
        _, frames, truth = self.make("all", source)
        self.assertEqual(frames, ["0", "1", "2"])
        self.assertTrue((self.out / "calib.txt").is_file())
        for pose, expected in zip(truth, ([1, 2, 3, 0, 0, 0, 1], [4, 5, 6, 0, math.sin(1.25), 0, math.cos(1.25)], [0, 0, 0, 0, 0, 1, 0])):
            for value, wanted in zip(pose[1:], expected):
                self.assertAlmostEqual(float(value), wanted, places=6)

    def test_ground_truth_far_from_a_frame_is_left_out(self):
        (self.tum / "groundtruth.txt").write_text("5.300000 3 0 0 0 0 0 1\n")
        make_sequence.make(self.tum, self.out, "all")
        self.assertEqual((self.out / "groundtruth.txt").read_text().count("\n"), 2)

    def test_copies_are_no_links(self):
        make_sequence.make(self.tum, self.out, "0-1,black:1", copy=True)
        self.assertFalse(any(path.is_symlink() for path in self.out.rglob("*")))

    def test_bad_sources_are_named(self):
        self.assert_fails("neither rgb.txt", source=self.folder)
        (self.tum / "rgb.txt").write_text("5 rgb/0.png\n5 rgb/1.png\n")
        self.assert_fails("must rise")
        (self.tum / "rgb.txt").write_text("5\n")
        self.assert_fails("rgb.txt:1: 2 columns expected")
        (self.tum / "rgb.txt").write_text("# nothing\n")
        self.assert_fails("lists no frame")
        (self.tum / "rgb.txt").write_text("now rgb/0.png\n")
        self.assert_fails("rgb.txt")
        source = self.make_kitti(["1 0 0 1 0 1 0 2 0 0 1 3"])
        (source / "times.txt").write_text("0\n1\n")
        self.assert_fails("1 poses for 2 times", source=source)


class OutTest(SequenceTest):
    def test_nothing_is_made_in_the_repository(self):
        with self.assertRaises(SequenceError) as caught:
            make_sequence.make(self.tum, make_sequence.REPOSITORY / "data", "all")
        self.assertIn("repository", str(caught.exception))

    def test_what_is_there_is_kept_without_force(self):
        self.out.mkdir()
        (self.out / "mine").write_text("")
        self.assert_fails("--force")
        self.assertTrue((self.out / "mine").exists())

    def test_named_sequences_are_made_once(self):
        kitchen = self.folder / "data" / "kitchen"
        kitchen.parent.mkdir()
        self.tum.rename(kitchen)
        make_sequence.make_named(kitchen.parent, self.out, ["kitchen_even"])
        mark = self.out / "kitchen_even" / "mark"
        mark.write_text("")
        make_sequence.make_named(kitchen.parent, self.out, ["kitchen_even"])
        self.assertTrue(mark.exists(), "made again though it was there")
        (self.out / "kitchen_even" / "rgb.txt").unlink()  # as a making that was broken off leaves it
        make_sequence.make_named(kitchen.parent, self.out, ["kitchen_even"])
        self.assertFalse(mark.exists())

    def test_command_line_tells_what_is_wrong(self):
        errors = io.StringIO()
        with contextlib.redirect_stderr(errors):
            self.assertEqual(make_sequence.main([str(self.folder / "none"), str(self.out)]), 2)
        self.assertIn("none: neither", errors.getvalue())


if __name__ == "__main__":
    unittest.main()
