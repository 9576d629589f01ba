import unittest

import report_table

COLUMNS = ("run", "ATE", "verdict")
TEXT = "words\n\n| run | ATE |\n| --- | --- |\n| a | 1 |\n| b | 2 |\n\n| other | table |\n| --- | --- |\n| c | 3 |\n"


class TableTest(unittest.TestCase):
    def test_reads_the_first_table_of_a_text(self):
        self.assertEqual(report_table.read(TEXT), [{"run": "a", "ATE": "1"}, {"run": "b", "ATE": "2"}])
        self.assertEqual(report_table.read("no table\n"), [])

    def test_an_empty_cell_is_read_as_one(self):
        self.assertEqual(report_table.read(report_table.head(COLUMNS) + "\n" + report_table.line(["a", "", "x"])), [{"run": "a", "ATE": "", "verdict": "x"}])

    def test_new_rows_take_the_old_ones_place_and_others_stay(self):
        self.assertEqual(report_table.merge(TEXT, COLUMNS, [["b", "5", "met"], ["d", "6", "met"]]), [["a", "1", "-"], ["b", "5", "met"], ["d", "6", "met"]])

    def test_rows_stand_in_the_order_asked_for_unknown_ones_behind(self):
        rows = report_table.merge(TEXT, COLUMNS, [["d", "6", "met"]], order=("d", "b"))
        self.assertEqual([row[0] for row in rows], ["d", "b", "a"])

    def test_a_table_of_other_things_is_not_taken_over(self):
        self.assertEqual(report_table.merge(TEXT, ("case", "ATE"), [["a", "7"]]), [["a", "7"]])


if __name__ == "__main__":
    unittest.main()
