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

import report_section
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

    def page_of(self, memory, with_plot):
        """A page with the section after a report of such memory."""
        self.report(memory, lambda s: 40)
        page = self.out / "docs" / "page.md"
        page.parent.mkdir()
        page.write_text("above\n" + "\n".join(report_section.markers(soak.SECTION)) + "\nbelow\n")
        soak.write_report(page, self.out, with_plot)
        return page

    def test_the_table_goes_into_its_section_of_a_page(self):
        lines = self.page_of(lambda s: 100 + min(s, 30), with_plot=False).read_text().splitlines()
        self.assertEqual((lines[0], lines[-1]), ("above", "below"))
        self.assertIn("20 laps of 100 frames in 3 minutes. From minute 0.5 on: medians of the first and the last quarter.", lines)
        self.assertIn("| process | memory [MB] | descriptors | queues | keyframes | verdict |", lines)
        self.assertIn("| frontend_tracker | 130.0 to 130.0 | 40.0 to 40.0 | 1.0 to 1.0 | 40.0 to 40.0 | flat |", lines)
        self.assertEqual(sum(line.endswith("| flat |") for line in lines), len(soak.ROLES))
        self.assertFalse((self.out / "docs" / "soak.svg").exists())

    def test_what_grew_is_named_in_the_table_and_the_plot_stands_beside_the_page_if_asked_for(self):
        page = self.page_of(lambda s: 100 + 0.2 * s, with_plot=True)
        self.assertIn("| grew: memory |", page.read_text())
        self.assertIn("(soak.svg)", page.read_text())
        self.assertEqual((page.parent / "soak.svg").read_bytes(), (self.out / "soak.svg").read_bytes())

    def test_a_run_too_short_to_judge_says_so(self):
        found = {"laps": 1, "lap_frames": 100, "minutes": 1, "judged_from_minute": 0.4, "verdicts": {}}
        self.assertEqual(soak.table(found).count("too few samples"), len(soak.ROLES))

    def test_a_page_without_the_section_is_refused_before_anything_runs(self):
        page = self.out / "page.md"
        page.write_text("# Page\n")
        for arguments, words in ((["--report", str(page)], "<!-- begin: soak (test/reliability/soak.py) -->"),
                                 (["--with-plot"], "--with-plot: goes with --report")):
            with contextlib.redirect_stderr(io.StringIO()) as errors, self.assertRaises(SystemExit):
                soak.parse(["--out", str(self.out), *arguments])
            self.assertIn(words, errors.getvalue())

    def test_no_samples_are_a_failure(self):
        (self.out / "samples.jsonl").touch()
        with self.assertRaises(soak.Failure):
            soak.report(self.out, lap=100)


if __name__ == "__main__":
    unittest.main()
