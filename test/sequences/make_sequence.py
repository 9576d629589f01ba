#!/usr/bin/env python3
"""Makes a sequence out of pieces of another: cuts, black frames, every n-th frame, laps driven twice, forward and backward.

  make_sequence.py ../shared/data/kitchen /tmp/cut --parts 0-449,black:110,250-999
  make_sequence.py ../shared/data/kitchen /tmp/even --parts all/2         every second frame, at its own time
  make_sequence.py ../shared/data/kitchen /tmp/odd --parts 1-last/2
  make_sequence.py ../shared/data/halls /tmp/fast --parts all@2           every second frame, at the rate of all: double speed
  make_sequence.py ../shared/data/town_lap /tmp/twice --parts all,all
  make_sequence.py ../shared/data/halls /tmp/back --parts all,last-0
  make_sequence.py ../shared/data --named /tmp/sequences                  all that the benchmark of the atlas needs

SOURCE has TUM layout (rgb.txt, groundtruth.txt) or KITTI layout (image_0, times.txt, poses.txt); what is made has TUM layout: links to
the source's images (--copy: copies), times that rise, the ground truth of each frame at its new time (black frames have none), the
source's camera file, and in source_frames.txt the source's frame number of each ("-": black). Frames are numbered from 0; a sequence of
one piece that goes forward keeps its source's times.
"""

import argparse
import bisect
import math
import pathlib
import shutil
import struct
import sys
import zlib

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
CAMERA_FILES = ("camera.yaml", "sensor.yaml", "calib.txt")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
BLACK = None  # in place of a source frame's number

# What the runs of the atlas (docs/tool.md, benchmark.py --atlas) are made from: {name: (source, parts)}.
NAMED = {
    "kitchen_cut": ("kitchen", "0-449,black:110,250-999"),
    "kitchen_first_half": ("kitchen", "0-499"),
    "kitchen_second_half": ("kitchen", "500-999"),
    "kitchen_even": ("kitchen", "all/2"),
    "kitchen_odd": ("kitchen", "1-last/2"),
    "kitchen_quarter_1": ("kitchen", "0-249"),
    "kitchen_quarter_2": ("kitchen", "250-499"),
    "kitchen_quarter_3": ("kitchen", "500-749"),
    "kitchen_quarter_4": ("kitchen", "750-last"),
    "town_lap_twice": ("town_lap", "all,all"),
    **{f"{name}_double_speed": (name, "all@2") for name in ("blackout", "halls", "kitchen", "kitti_00", "office_walk", "town_lap")},
}


class SequenceError(Exception):
    """What is wrong with the source or the parts, in words."""


class Source:
    """A sequence as it lies on the disk. `times`: seconds as text; `images`: paths; `poses`: {frame: "tx ty tz qx qy qz qw"}."""

    def __init__(self, folder):
        self.folder = folder
        if (folder / "rgb.txt").is_file():
            rows = read_rows(folder / "rgb.txt", 2)
            self.times = [row[0] for row in rows]
            self.images = [folder / row[1] for row in rows]
            self._check_times(folder / "rgb.txt")
            self.poses = self._read_tum_poses() if (folder / "groundtruth.txt").is_file() else {}
        elif (folder / "times.txt").is_file() and (folder / "image_0").is_dir():
            self.times = [row[0] for row in read_rows(folder / "times.txt", 1)]
            self.images = sorted(path for path in (folder / "image_0").iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
            self._check_times(folder / "times.txt")
            self.poses = self._read_kitti_poses() if (folder / "poses.txt").is_file() else {}
        else:
            raise SequenceError(f"{folder}: neither rgb.txt (TUM) nor times.txt with image_0 (KITTI)")
        if len(self.images) != len(self.times):
            raise SequenceError(f"{folder}: {len(self.times)} times for {len(self.images)} images")

    @property
    def seconds(self):
        return [float(time) for time in self.times]

    def interval(self):
        """Median seconds between two frames."""
        seconds = self.seconds
        steps = sorted(b - a for a, b in zip(seconds, seconds[1:]))
        return steps[len(steps) // 2] if steps else 1.0

    def camera_file(self):
        return next((self.folder / name for name in CAMERA_FILES if (self.folder / name).is_file()), None)

    def _check_times(self, path):
        if not self.times:
            raise SequenceError(f"{path}: lists no frame")
        try:
            seconds = self.seconds
        except ValueError as error:
            raise SequenceError(f"{path}: {error}") from error
        for a, b in zip(seconds, seconds[1:]):
            if not a < b:
                raise SequenceError(f"{path}: times must rise, but {b} follows {a}")

    def _read_tum_poses(self):
        """Of each frame the pose nearest in time, if it is within half an interval."""
        rows = read_rows(self.folder / "groundtruth.txt", 8)
        stamps = [float(row[0]) for row in rows]
        poses, tolerance = {}, self.interval() / 2 + 1e-6
        for frame, time in enumerate(self.seconds):
            after = bisect.bisect_left(stamps, time)
            near = min((i for i in (after - 1, after) if 0 <= i < len(stamps)), key=lambda i: abs(stamps[i] - time), default=None)
            if near is not None and abs(stamps[near] - time) <= tolerance:
                poses[frame] = " ".join(rows[near][1:])
        return poses

    def _read_kitti_poses(self):
        rows = read_rows(self.folder / "poses.txt", 12)
        if len(rows) != len(self.times):
            raise SequenceError(f"{self.folder / 'poses.txt'}: {len(rows)} poses for {len(self.times)} times")
        return {frame: pose_of_matrix([float(value) for value in row]) for frame, row in enumerate(rows)}


def read_rows(path, columns):
    """Fields of each line, without comments. Fails on another number of columns."""
    rows = []
    for number, line in enumerate(path.read_text().splitlines(), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        if len(fields) != columns:
            raise SequenceError(f"{path}:{number}: {columns} columns expected, found {len(fields)}")
        rows.append(fields)
    return rows


def pose_of_matrix(row):
    """A 3x4 matrix, by rows, as "tx ty tz qx qy qz qw". The quaternion by its largest component, so that nothing cancels."""
    r = [row[0:3], row[4:7], row[8:11]]
    trace = r[0][0] + r[1][1] + r[2][2]
    squares = [1 + 2 * r[i][i] - trace for i in range(3)] + [1 + trace]  # 4 x^2, 4 y^2, 4 z^2, 4 w^2
    largest = max(range(4), key=lambda i: squares[i])
    s = 2 * math.sqrt(squares[largest])  # 4 times that component
    if largest == 3:
        q = [(r[2][1] - r[1][2]) / s, (r[0][2] - r[2][0]) / s, (r[1][0] - r[0][1]) / s, s / 4]
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q = [0.0] * 4
        q[i], q[j], q[k], q[3] = s / 4, (r[j][i] + r[i][j]) / s, (r[k][i] + r[i][k]) / s, (r[k][j] - r[j][k]) / s
    return " ".join(f"{value:.9f}" for value in [row[3], row[7], row[11], *q])


def parse_frame(text, last):
    frame = last if text == "last" else int(text) if text.isdigit() else None
    if frame is None:
        raise SequenceError(f"'{text}' is no frame: a number or 'last' expected")
    if frame > last:
        raise SequenceError(f"frame {frame}: the source's last one is {last}")
    return frame


def parse_part(text, last):
    """One piece: (frames, step of time that they take in source intervals, None: their own times)."""
    if text.startswith("black:"):
        count = text[len("black:"):]
        if not count.isdigit() or int(count) == 0:
            raise SequenceError(f"'{text}': a number of frames above 0 expected after black:")
        return [BLACK] * int(count), False
    span, every, fast = text, 1, False
    for mark in "/@":
        if mark in text:
            span, _, step = text.partition(mark)
            if not step.isdigit() or int(step) == 0:
                raise SequenceError(f"'{text}': a number above 0 expected after {mark}")
            every, fast = int(step), mark == "@"
    first_text, dash, last_text = ("0", "-", "last") if span == "all" else span.partition("-")
    if not dash:
        raise SequenceError(f"'{text}': FIRST-LAST, all or black:N expected")
    begin, end = parse_frame(first_text, last), parse_frame(last_text, last)
    return (list(range(begin, end + 1, every)) if begin <= end else list(range(begin, end - 1, -every))), fast


def compose(source, parts):
    """[(seconds as text, source frame or BLACK)] of the parts, in order."""
    pieces = [parse_part(part, len(source.times) - 1) for part in parts.split(",")]
    frames, fast = pieces[0]
    if len(pieces) == 1 and not fast and frames[0] is not BLACK and frames[0] <= frames[-1]:
        return [(source.times[frame], frame) for frame in frames]
    seconds, interval, now, made = source.seconds, source.interval(), None, []
    for frames, fast in pieces:
        before = None
        for frame in frames:
            natural = interval if before is None or frame is BLACK or fast else abs(seconds[frame] - seconds[before])
            now = 0.0 if now is None else now + natural
            before = frame
            made.append((f"{now:.6f}", frame))
    return made


def image_size(path):
    """(width, height) of a PNG or JPEG, from its header."""
    data = path.read_bytes()
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        return struct.unpack(">II", data[16:24])
    at = 2
    while data[:2] == b"\xff\xd8" and at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], struct.unpack(">H", data[at + 2:at + 4])[0]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # start of a frame
            height, width = struct.unpack(">HH", data[at + 5:at + 9])
            return width, height
        at += 2 + length
    raise SequenceError(f"{path}: neither PNG nor JPEG")


def black_png(width, height):
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)  # 8 bit grey
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes((width + 1) * height))) + chunk(b"IEND", b"")


def place(source_file, target, copy):
    if copy:
        shutil.copyfile(source_file, target)
    else:
        target.symlink_to(source_file.resolve())


def check_out(out, force):
    if REPOSITORY in [out.resolve(), *out.resolve().parents]:
        raise SequenceError(f"{out}: is in the repository; data stays out of it")
    if out.exists() and any(out.iterdir() if out.is_dir() else [out]):
        if not force:
            raise SequenceError(f"{out}: exists and is not empty; --force replaces it")
        shutil.rmtree(out) if out.is_dir() else out.unlink()


def make(source_folder, out, parts, copy=False, force=False):
    """Makes OUT. The lists are written last: where they are, the images are whole. Returns the number of frames."""
    source = Source(source_folder)
    made = compose(source, parts)
    check_out(out, force)
    (out / "rgb").mkdir(parents=True)
    if any(frame is BLACK for _, frame in made):
        (out / "black.png").write_bytes(black_png(*image_size(source.images[0])))
    images = ["# timestamp filename"]
    for number, (time, frame) in enumerate(made):
        image = out / "black.png" if frame is BLACK else source.images[frame]
        name = f"rgb/{number:06}{image.suffix.lower()}"
        place(image, out / name, copy)
        images.append(f"{time} {name}")
    if source.camera_file():
        place(source.camera_file(), out / source.camera_file().name, copy)
    truth = ["# timestamp tx ty tz qx qy qz qw"] + [f"{time} {source.poses[frame]}" for time, frame in made if frame in source.poses]
    (out / "source_frames.txt").write_text("".join(f"{time} {'-' if frame is BLACK else frame}\n" for time, frame in made))
    if source.poses:
        (out / "groundtruth.txt").write_text("\n".join(truth) + "\n")
    (out / "rgb.txt").write_text("\n".join(images) + "\n")
    return len(made)


def is_made_from(out, source_folder, parts):
    """Whether OUT holds just what would be made."""
    try:
        made = compose(Source(source_folder), parts)
        lines = (out / "source_frames.txt").read_text().splitlines()
        return (out / "rgb.txt").is_file() and lines == [f"{time} {'-' if frame is BLACK else frame}" for time, frame in made]
    except (OSError, SequenceError):
        return False


def make_named(data, out, names=None, copy=False):
    """Makes the named sequences (all: None) that are not there yet, in folders of their names below OUT."""
    for name in names or NAMED:
        source, parts = NAMED[name]
        if not is_made_from(out / name, data / source, parts):
            make(data / source, out / name, parts, copy, force=True)


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    parser.add_argument("source", type=pathlib.Path, help="folder of the sequence; with --named, of the sequences")
    parser.add_argument("out", type=pathlib.Path, help="folder to be made, outside the repository")
    parser.add_argument("--parts", default="all", help="FIRST-LAST (backward if FIRST > LAST; 'last', 'all'), FIRST-LAST/N, FIRST-LAST@N, black:N; "
                                                      "several with commas")
    parser.add_argument("--named", action="store_true", help="make the benchmark's sequences: " + ", ".join(NAMED))
    parser.add_argument("--copy", action="store_true", help="copy images in place of links")
    parser.add_argument("--force", action="store_true", help="replace what is in OUT")
    options = parser.parse_args(arguments)
    try:
        if options.named:
            make_named(options.source, options.out, copy=options.copy)
        else:
            print(f"{options.out}: {make(options.source, options.out, options.parts, options.copy, options.force)} frames")
    except (OSError, SequenceError) as error:
        print(f"make_sequence.py: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
