#!/usr/bin/env python3
"""Tests of what soak.py makes of its samples."""

import contextlib
import io
import json
import math
import pathlib
import tempfile
import unittest
import xml.etree.ElementTree

import soak


def circle(num_frames, per_lap):
    return [((math.cos(a), math.sin(a), 0.0), (0.0, 0.0, math.sin(a / 2), math.cos(a / 2)))
            for a in (2 * math.pi * i / per_lap for i in range(num_frames))]


class LapTest(unittest.TestCase):
    def test_finds_where_the_camera_is_back(self):
        self.assertEqual(soak.find_lap(circle(133, 100)), 100)

    def test_a_way_that_does_not_come_back_is_refused(self):
        with self.assertRaises(soak.Failure):
            soak.find_lap(circle(60, 100))

    def test_laps_list_the_first_laps_pictures_again_with_times_that_rise(self):
        with tempfile.TemporaryDirectory() as folder:
            data, laps = pathlib.Path(folder) / "data", pathlib.Path(folder) / "laps"
            (data / "rgb").mkdir(parents=True)
            (data / "camera.yaml").write_text("model: pinhole\n")
            poses = circle(133, 100)
            (data / "groundtruth.txt").write_text("".join(f"{i} {' '.join(map(str, (*p, *q)))}\n" for i, (p, q) in enumerate(poses)))
            (data / "rgb.txt").write_text("# pictures\n" + "".join(f"{i} rgb/{i}.jpg\n" for i in range(133)))
            self.assertEqual(soak.write_laps(data, laps, 250), 100)
            lines = [line.split() for line in (laps / "rgb.txt").read_text().splitlines()]
            self.assertEqual([lines[i][1] for i in (0, 99, 100, 249)], ["rgb/0.jpg", "rgb/99.jpg", "rgb/0.jpg", "rgb/49.jpg"])
            times = [float(line[0]) for line in lines]
            self.assertEqual(times, sorted(set(times)))


class ReportTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.out = pathlib.Path(folder.name)

    def report(self, memory, files):
        """Of samples whose memory [MB] and descriptors are functions of the second; a lap takes ten seconds."""
        with open(self.out / "samples.jsonl", "w", encoding="utf-8") as file:
            for s in range(200):
                figures = {"frames": s * 10, "resident_bytes": memory(s) * 1e6, "open_files": files(s), "events_waiting": s % 3, "keyframes": min(s, 40)}
                processes = [{"role": role, "figures": figures} for role in soak.ROLES]
                file.write(json.dumps({"s": s, "processes": processes}) + "\n")
        with contextlib.redirect_stdout(io.StringIO()) as said:
            flat = soak.report(self.out, lap=100)
        return flat, said.getvalue()

    def test_what_settles_in_the_first_laps_is_flat(self):
        flat, said = self.report(lambda s: 100 + min(s, 30), lambda s: 40)
        self.assertTrue(flat, said)
        self.assertIn("19.9 laps", said)

    def test_what_goes_on_growing_is_named(self):
        flat, said = self.report(lambda s: 100 + 0.2 * s, lambda s: 40)
        self.assertFalse(flat)
        self.assertRegex(said, r"memory \[MB\] +frontend_tracker.*GREW")
        self.assertFalse(self.report(lambda s: 100, lambda s: 40 + s // 20)[0])

    def test_the_plot_is_xml_with_a_line_for_each_role_and_panel(self):
        self.report(lambda s: 100, lambda s: 40)
        root = xml.etree.ElementTree.parse(self.out / "soak.svg").getroot()
        self.assertEqual(len(root.findall("{http://www.w3.org/2000/svg}polyline")), len(soak.ROLES) * len(soak.PANELS))

    def test_no_samples_are_a_failure(self):
        (self.out / "samples.jsonl").touch()
        with self.assertRaises(soak.Failure):
            soak.report(self.out, lap=100)


if __name__ == "__main__":
    unittest.main()
