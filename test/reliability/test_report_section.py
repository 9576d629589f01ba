#!/usr/bin/env python3
"""Tests of report_section.py."""

import pathlib
import tempfile
import unittest

import report_section
from report_section import SectionError

PAGE = "# Page\nwords\n<!-- begin: kills -->\nold\n<!-- end: kills -->\n\n<!-- begin: links -->\n<!-- end: links -->\nlast\n"


class ReplaceTest(unittest.TestCase):
    def test_what_is_between_the_markers_goes_and_the_rest_stays(self):
        page = report_section.replace(PAGE, "kills", "| a |\n")
        self.assertEqual(page, PAGE.replace("old\n", "| a |\n"))

    def test_an_empty_section_is_filled_and_filled_again(self):
        once = report_section.replace(PAGE, "links", "new")
        self.assertIn("<!-- begin: links -->\nnew\n<!-- end: links -->\nlast\n", once)
        self.assertEqual(report_section.replace(once, "links", "new"), once)

    def test_a_page_without_the_section_is_refused(self):
        for page in ("", PAGE.replace("<!-- end: kills -->", ""), PAGE + PAGE, "<!-- end: kills --><!-- begin: kills -->"):
            with self.assertRaises(SectionError):
                report_section.replace(page, "kills", "new")

    def test_a_file_is_rewritten_and_named_when_it_can_not_be(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "page.md"
            path.write_text(PAGE)
            report_section.write(path, "kills", "new")
            self.assertEqual(path.read_text(), PAGE.replace("old", "new"))
            with self.assertRaisesRegex(SectionError, "page.md: expected the line '<!-- begin: other -->' once"):
                report_section.write(path, "other", "new")
            self.assertEqual([entry.name for entry in pathlib.Path(folder).iterdir()], ["page.md"])


if __name__ == "__main__":
    unittest.main()
