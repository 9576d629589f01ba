#!/usr/bin/env python3
"""Programs load the libraries they use and no others: OpenCV's codecs bring a hundred with them, 40 MB in each process."""

import os
import pathlib
import re
import subprocess
import unittest

BIN = pathlib.Path(os.environ["PORTOLAN_BIN"])
NEEDED = re.compile(r"\(NEEDED\).*\[(.+)\]")
IMAGE_FILES = re.compile(r"^libopencv_(imgcodecs|videoio)\.so")


def needed(program):
    listing = subprocess.run(["readelf", "--dynamic", "--wide", BIN / program], capture_output=True, text=True, check=True)
    return NEEDED.findall(listing.stdout)


class LibrariesTest(unittest.TestCase):
    def image_libraries(self, program):
        return [library for library in needed(program) if IMAGE_FILES.match(library)]

    def test_processes_load_no_image_codecs(self):
        for program in ("portolan_atlas_server", "portolan_backend_mapper", "portolan_frontend_tracker", "portolan_loop_closer"):
            self.assertEqual(self.image_libraries(program), [], program)

    def test_the_library_of_codecs_does(self):
        # Were the libraries' names to change, the check above would pass without looking at anything.
        self.assertEqual(len(self.image_libraries("../lib/portolan/libportolan_media.so")), 2)


if __name__ == "__main__":
    unittest.main()
