import unittest

import motion_models

SUMMARY = """frames 373 online 330 trajectory 340 keyframes sent 190
maps 3 links 1 unlinked 1 switches 1 fusions 0; frames to a new map: 12 9
map 0.1.1: 80 keyframes, 9000 points
"""


class MotionModelsTest(unittest.TestCase):
    def test_reads_what_the_program_prints(self):
        self.assertEqual(motion_models.parse_summary(SUMMARY), (373, 330, 3))
        with self.assertRaisesRegex(ValueError, "no summary"):
            motion_models.parse_summary("frames 373\n")

    def test_table_has_means_of_runs_and_over_all(self):
        few, many = [(100, 98, 1), (100, 100, 2)], [(50, 40, 4), (50, 44, 5)]
        results = {("kitchen", 1): dict.fromkeys(motion_models.MODELS, few), ("kitchen", 2): dict.fromkeys(motion_models.MODELS, many)}
        lines = motion_models.table(results, 2).split("\n")
        self.assertIn("means of 2 runs", lines[0])
        self.assertEqual(lines[4].count("1.5 (99 of 100)"), 3)
        self.assertEqual(lines[5].count("4.5 (42 of 50)"), 3)
        self.assertTrue(lines[5].startswith("| kitchen, every second frame |"))
        self.assertEqual(lines[6].count("3.00"), 3)


if __name__ == "__main__":
    unittest.main()
