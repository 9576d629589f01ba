#!/usr/bin/env python3
"""How many maps begin with a wrong motion (paper Sec. 4.1): a map is begun at every n-th frame of a sequence, forward and backward, and compared with the ground truth.

Each run is tracker, mapper and loop closer in one process and in lockstep (portolan_pipeline_run) over some frames. Of each map that came of it, the camera's steps over five frames
are compared with the true ones, each in its own camera's frame, so that neither scale nor place matters: a map is called wrong where the median angle between their directions is above 30
degrees, and poor above 12. Of the steps the longer half counts: short ones have no direction to speak of.

  test/benchmark/beginnings.py                                    all of ../shared/data: an hour
  test/benchmark/beginnings.py --sequences office_walk --every 8 --jobs 2
"""

import argparse
import concurrent.futures
import math
import pathlib
import statistics
import sys
import tempfile

import pipeline_run

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "test" / "sequences"))

import make_sequence  # noqa: E402  (its folder is known only now)

STEP = 5  # frames
WRONG_DEG, POOR_DEG = 30, 12
MIN_STEPS = 3  # of a map that is judged


def turn(q, v):
    """v by the quaternion x, y, z, w."""
    x, y, z, w = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return [v[0] + w * tx + y * tz - z * ty, v[1] + w * ty + z * tx - x * tz, v[2] + w * tz + x * ty - y * tx]


def step_in_camera(first, second):
    """From one pose (tx ty tz qx qy qz qw, camera to map) to another, in the first one's camera frame."""
    x, y, z, w = first[3:]
    return turn((-x, -y, -z, w), [b - a for a, b in zip(first[:3], second[:3])])


def angle_deg(a, b):
    """Between two vectors; None where one has no length."""
    lengths = math.hypot(*a) * math.hypot(*b)
    if lengths == 0:
        return None
    return math.degrees(math.acos(max(-1.0, min(1.0, sum(i * j for i, j in zip(a, b)) / lengths))))


def direction_error_deg(poses):
    """Median over the steps of a map, of [(pose, true pose)] by frame; None: too few."""
    errors = []
    for (first, true_first), (second, true_second) in zip(poses, poses[STEP:]):
        true_step = step_in_camera(true_first, true_second)
        error = angle_deg(step_in_camera(first, second), true_step)
        if error is not None:
            errors.append((math.hypot(*true_step), error))
    if len(errors) < MIN_STEPS:
        return None
    middle = statistics.median(length for length, _ in errors)
    return statistics.median(error for length, error in errors if length >= middle)


def read_maps(path, source):
    """{map: [(pose, true pose)]} of a trajectory_maps.txt, by the frames of the source that have ground truth."""
    frame_of = {round(seconds, 3): frame for frame, seconds in enumerate(source.seconds)}
    maps = {}
    for row in make_sequence.read_rows(path, 9):
        frame = frame_of.get(round(float(row[0]), 3))
        if frame in source.poses:
            true = [float(value) for value in source.poses[frame].split()]
            maps.setdefault(row[8], []).append(([float(value) for value in row[1:8]], true))
    return maps


def begin_at(program, sequence, source, first, frames, settings):
    """Direction errors, degrees, of the maps that came of the frames."""
    with tempfile.TemporaryDirectory(prefix="beginnings_") as out:
        pipeline_run.run(program, sequence, out, settings, "--first", first, "--frames", frames)
        maps = read_maps(pathlib.Path(out) / "trajectory_maps.txt", source)
    errors = [direction_error_deg(poses) for poses in maps.values()]
    return [error for error in errors if error is not None]


def table(results):
    """Markdown; results by name: direction errors of each beginning."""
    lines = ["| sequence | beginnings | maps | poor | wrong | median direction error |", "| --- | --- | --- | --- | --- | --- |"]
    for name, beginnings in results.items():
        errors = [error for maps in beginnings for error in maps]
        wrong = sum(error > WRONG_DEG for error in errors)
        poor = sum(error > POOR_DEG for error in errors) - wrong
        median = f"{statistics.median(errors):.1f} deg" if errors else "none"
        lines.append(f"| {name} | {len(beginnings)} | {len(errors)} | {poor} | {wrong} | {median} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, default=REPOSITORY.parent / "shared" / "data", help="folder of sequences (default: %(default)s)")
    parser.add_argument("--sequences", nargs="+", help="some of them (default: all that have ground truth)")
    parser.add_argument("--every", type=int, default=10, help="frames from one beginning to the next (default: %(default)s)")
    parser.add_argument("--frames", type=int, default=40, help="of each run (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time (default: %(default)s)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the configuration (repeatable)")
    parser.add_argument("--program", type=pathlib.Path, default=REPOSITORY / "install" / "bin" / "portolan_pipeline_run")
    options = parser.parse_args()
    if not options.program.is_file():
        parser.error(f"{options.program} is not there: build first (launch_scripts/build.sh)")
    if min(options.every, options.jobs) < 1 or options.frames <= STEP:
        parser.error(f"--every and --jobs: expected 1 or more; --frames: more than {STEP}")
    names = options.sequences or sorted(path.parent.name for pattern in ("*/groundtruth.txt", "*/poses.txt") for path in options.data.glob(pattern))
    if not names:
        parser.error(f"no sequence with ground truth in {options.data}")

    results = {}
    with tempfile.TemporaryDirectory(prefix="backward_") as backward, concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        for name in names:
            try:
                make_sequence.make(options.data / name, pathlib.Path(backward) / name, "last-0")
                sources = {name: options.data / name, f"{name}, backward": pathlib.Path(backward) / name}
                for title, folder in sources.items():
                    source = make_sequence.Source(folder)
                    starts = range(0, max(1, len(source.times) - options.frames), options.every)
                    futures = [pool.submit(begin_at, options.program, folder, source, first, options.frames, options.set) for first in starts]
                    results[title] = [future.result() for future in futures]
                    print(table({title: results[title]}).splitlines()[-1], file=sys.stderr, flush=True)
            except (OSError, make_sequence.SequenceError) as error:
                parser.error(str(error))
    print(table(results))


if __name__ == "__main__":
    main()
