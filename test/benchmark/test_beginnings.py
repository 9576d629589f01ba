import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

import beginnings
import make_sequence

QUARTER_TURN = [0, math.sqrt(0.5), 0, math.sqrt(0.5)]  # about y


def walk(direction, turned, frames=12, length=0.1):
    """Poses along a direction of the map, all looking the same way; steps grow, so that half of them count."""
    distances = [length * i * (1 + 0.01 * i) for i in range(frames)]
    return [[d * a for a in direction] + turned for d in distances]


class BeginningsTest(unittest.TestCase):
    def test_neither_scale_nor_place_nor_the_maps_frame_matters(self):
        true = walk([1, 0, 0], QUARTER_TURN)  # in the camera: a quarter turn back about y takes x to z
        same = [[3 + p[0], 5, 7, *QUARTER_TURN] for p in walk([4, 0, 0], QUARTER_TURN)]
        self.assertAlmostEqual(beginnings.direction_error_deg(list(zip(same, true))), 0, places=4)
        elsewhere = walk([0, 0, 0.2], [0, 0, 0, 1])
        self.assertAlmostEqual(beginnings.direction_error_deg(list(zip(elsewhere, true))), 0, places=4)

    def test_a_reversed_motion_is_180_degrees_off(self):
        true = walk([0, 0, 1], [0, 0, 0, 1])
        self.assertAlmostEqual(beginnings.direction_error_deg(list(zip(walk([0, 0, -1], [0, 0, 0, 1]), true))), 180, places=4)
        self.assertAlmostEqual(beginnings.direction_error_deg(list(zip(walk([1, 0, 0], [0, 0, 0, 1]), true))), 90, places=4)

    def test_too_few_steps_are_not_judged(self):
        true = walk([0, 0, 1], [0, 0, 0, 1], frames=beginnings.STEP + beginnings.MIN_STEPS - 1)
        self.assertIsNone(beginnings.direction_error_deg(list(zip(true, true))))

    def test_the_table_counts_poor_and_wrong_maps(self):
        lines = beginnings.table({"walk": [[1.0], [20.0, 50.0], []]}).split("\n")
        self.assertEqual(lines[2], "| walk | 3 | 3 | 1 | 1 | 20.0 deg |")

    def test_maps_are_read_with_the_truth_of_their_frames(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            (folder / "rgb.txt").write_text("0.1 rgb/0.png\n0.2 rgb/1.png\n")
            (folder / "groundtruth.txt").write_text("0.1 1 2 3 0 0 0 1\n")
            (folder / "maps.txt").write_text("0.1 0 0 0 0 0 0 1 4\n0.2 0 0 1 0 0 0 1 4\n")
            maps = beginnings.read_maps(folder / "maps.txt", make_sequence.Source(folder))
        self.assertEqual(maps, {"4": [([0, 0, 0, 0, 0, 0, 1], [1, 2, 3, 0, 0, 0, 1])]})

    def test_wrong_options_are_named(self):
        def run(*arguments):
            done = subprocess.run([sys.executable, "-B", beginnings.__file__, *arguments], capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 2)
            return done.stderr
        self.assertIn("is not there: build first", run("--program", "/nowhere"))
        self.assertIn("--frames: more than 5", run("--program", sys.executable, "--frames", "5"))
        self.assertIn("/nowhere", run("--program", sys.executable, "--data", "/nowhere", "--sequences", "walk"))


if __name__ == "__main__":
    unittest.main()
