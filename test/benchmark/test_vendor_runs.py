import pathlib
import tempfile
import unittest

import sequence_runs
import vendor_runs

KITCHEN = sequence_runs.Sequence("kitchen", pathlib.Path("kitchen"), None)


def run(**more):
    return {"poses": 990, "frames": 1000, "ate": 0.04, "median_ms": 30.0, "orb_ms": 20.0, "orb_ratio": 1.5, "p95_ratio": 1.4, "keyframe_ms": 40, "cpu_s": 50.0,
            "memory_mb": 500, **more}


def cells_of(setup, runs, lockstep, reference, is_same=None):
    return dict(zip(vendor_runs.COLUMNS, vendor_runs.row(KITCHEN, setup, runs, is_same, lockstep, reference), strict=True))


class VendorRunsTest(unittest.TestCase):
    def test_trajectories_are_compared_byte_by_byte(self):
        with tempfile.TemporaryDirectory() as folder:
            one, other = pathlib.Path(folder) / "one", pathlib.Path(folder) / "other"
            one.write_text("1 a\n2 b\n")
            for text, words in (("1 a\n2 b\n", "byte-equal"), ("1 a\n2 c\n", "differ from line 2 on"), ("1 a\n2 b\n3 c\n", "differ from line 3 on"),
                                ("1 a\n", "differ from line 2 on"), ("1 a\n2 b", "differ from line 2 on")):
                other.write_text(text)
                self.assertEqual(vendor_runs.difference(one, other), words)
            one.write_text("")
            other.write_text("")
            self.assertEqual(vendor_runs.difference(one, other), "no poses to compare")

    def test_figures_are_apart_beyond_what_runs_of_one_vendor_differ(self):
        self.assertFalse(vendor_runs.is_apart("ate", 0.1, [run(ate=0.043)], [run(ate=0.04)]))
        self.assertTrue(vendor_runs.is_apart("ate", 0.1, [run(ate=0.045)], [run(ate=0.04)]))
        self.assertFalse(vendor_runs.is_apart("ate", 0.1, [run(ate=0.045)], [run(ate=ate) for ate in (0.038, 0.04, 0.044)]))
        self.assertTrue(vendor_runs.is_apart("ate", 0.1, [run(ate=None)], [run()]))

    def test_a_row_is_judged_by_lockstep_and_by_the_first_vendor(self):
        cells = cells_of("Cyclone DDS", [run(ate=0.046, cpu_s=70.0)], [run()] * 2, [run()])
        self.assertEqual(cells["of lockstep"], "115 % (≤ 115 %)")
        self.assertEqual(cells["verdict"], "apart: ATE to Fast DDS's, CPU to Fast DDS's")
        self.assertEqual(cells_of("Fast DDS", [run(ate=0.047)], [run()] * 2, None)["verdict"], "apart: ATE to lockstep's")
        self.assertEqual(cells_of("Fast DDS", [run()], [{"failure": 1}] * 2, None)["verdict"], "apart: ATE to lockstep's")
        self.assertEqual(cells_of("Fast DDS", [run()], [run()] * 2, None)["verdict"], "met")

    def test_cells_show_how_far_runs_differ(self):
        cells = cells_of("Fast DDS", [run(ate=ate, memory_mb=500) for ate in (0.042, 0.04, 0.041)], [run()] * 2, None)
        self.assertEqual((cells["ATE (m)"], cells["MB"]), ("0.0410 (0.0400 to 0.0420)", "500"))

    def test_lockstep_is_judged_by_its_trajectories(self):
        cells = cells_of("lockstep", [run(), run()], [run(), run()], None, "differ from line 7 on")
        self.assertEqual((cells["of lockstep"], cells["verdict"]), ("-", "differ from line 7 on"))
        self.assertEqual(cells_of("lockstep", [run(), {"failure": 1}], [], None)["verdict"], "1 of 2 runs failed")

    def test_runs_that_failed_have_a_row(self):
        cells = cells_of("Cyclone DDS", [{"failure": 1}], [run()], [run()])
        self.assertEqual((cells["run"], cells["tracked"], cells["verdict"]), ("kitchen, Cyclone DDS", "failed", "1 of 1 runs failed"))


if __name__ == "__main__":
    unittest.main()
