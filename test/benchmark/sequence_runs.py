"""A sequence measured once: run.sh and cv::ORB on the same frames, and its row in the table of figures. For benchmark.py."""

import argparse
import collections
import json
import pathlib
import subprocess

from figures_to_meet import at_least, at_most, beside, done, median, show, verdict

LAUNCHER = pathlib.Path(__file__).resolve().parents[2] / "launch_scripts" / "run.sh"
FRONTEND, LOOP_CLOSER = "frontend_tracker", "loop_closer"
# Where each layout has its ground truth, and its list of frames: TUM, KITTI, EuRoC.
GROUND_TRUTHS = ("groundtruth.txt", "poses.txt", "mav0/state_groundtruth_estimate0/data.csv")
FRAME_LISTS = ("rgb.txt", "times.txt", "mav0/cam0/data.csv")

# frames: (first, last) of the folder's; None: all.
Sequence = collections.namedtuple("Sequence", "name folder frames")

# Spans of a sequence that are measured by themselves besides the whole.
SPANS = {"blackout": ((0, 246),)}
# Frames that see a place again, and those that saw it before (shared/data/README.md): each is to be closed by a loop. Only where one map holds both.
REVISITS = {
    "town_lap": (((865, 1135), (0, 268)),),
    "halls": (((550, 615), (0, 63)), ((630, 655), (479, 502)), ((935, 985), (536, 582)), ((990, 1065), (43, 118))),
}
REVISIT_MARGIN = 15  # frames: where a place begins and ends to be seen again is roughly known

# Of issues 3 and 4; blackout, office_walk and halls as a whole: of issue 5.
FOR_ALL = (at_most("p95_ratio", "p95 / median", 2), at_most("keyframe_ms", "keyframe's way", 60), at_most("memory_mb", "MB", 700))


def limits_of(poses, ate, *more):
    return (at_least("poses", "tracked", poses), at_most("ate", "ATE", ate), *FOR_ALL, *more)


LIMITS = {
    "kitti_00": limits_of(297, 1.6, at_most("orb_ratio", "x ORB", 1.5), at_most("cpu_s", "CPU", 35)),
    "kitchen": limits_of(975, 0.038, at_most("orb_ratio", "x ORB", 2.5), at_most("cpu_s", "CPU", 55)),
    "town_lap": limits_of(1130, 5, at_least("revisits", "lap closed", 1, is_optional=True), at_most("loop_closer_mb", "loop_closer's MB", 300)),
    "blackout": limits_of(730, 0.1),
    "blackout, frames 0-246": limits_of(235, 0.02),
    "office_walk": limits_of(300, 0.4),
    # "over the frames that stay in one map", "each revisit inside it closed"
    "halls": (at_least("poses", "tracked", 1020), at_most("map_ate", "ATE in one map", 0.12), *FOR_ALL,
              at_least("revisits", "revisits closed", 4, is_optional=True)),
}

COLUMNS = ("sequence", "tracked", "ATE (m)", "largest map's (m)", "maps", "keyframes", "revisits closed", "frame ms", "p95 ms", "cv::ORB ms", "x ORB",
           "p95 / median", "keyframe's way (ms)", "CPU s", "MB", "loop_closer MB", "verdict")


class UsageError(Exception):
    """What is wrong with the arguments, in words."""


def find_ground_truth(folder):
    return next((folder / name for name in GROUND_TRUTHS if (folder / name).is_file()), None)


def is_sequence(folder):
    return find_ground_truth(folder) is not None or any((folder / name).is_file() for name in FRAME_LISTS)


def parse_span(text):
    """"first-last" as two numbers."""
    first, dash, last = text.partition("-")
    if not (dash and first.isdigit() and last.isdigit() and int(first) <= int(last)):
        raise argparse.ArgumentTypeError(f"'{text}', expected FIRST-LAST as in 0-246")
    return int(first), int(last)


def make_sequence(folder, span=None):
    return Sequence(f"{folder.name}, frames {span[0]}-{span[1]}" if span else folder.name, folder, span)


def with_spans(folder):
    """The whole sequence, and the spans of it that have figures to meet."""
    return [make_sequence(folder), *(make_sequence(folder, span) for span in SPANS.get(folder.name, ()))]


def run_command(command, log):
    """Standard output of a program; its standard error goes to the end of `log`. Raises CalledProcessError."""
    with open(log, "ab") as errors:
        return subprocess.run([str(part) for part in command], check=True, stdout=subprocess.PIPE, stderr=errors, text=True).stdout


def frame_seconds(folder):
    """Times of the frames of a sequence in TUM or KITTI layout."""
    path = next(folder / name for name in FRAME_LISTS if (folder / name).is_file())
    return [float(line.split()[0]) for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


def has_poses(trajectory):
    return trajectory.is_file() and any(line.strip() and not line.startswith("#") for line in trajectory.read_text().splitlines())


def evaluate(folder, trajectory, result, options, span=None, run=run_command):
    """What portolan_eval says; None where there is no ground truth or no pose."""
    truth = find_ground_truth(folder)
    if truth is None or not has_poses(trajectory):
        return None
    command = [options.bin / "portolan_eval", truth, trajectory, "--json", result]
    if span:
        command += ["--first-frame", span[0], "--last-frame", span[1]]
    run(command, result.parent / "benchmark.log")
    return json.loads(result.read_text())


def measure_orb(sequence, log, options, run=run_command):
    """Milliseconds of cv::ORB on the sequence's frames, now."""
    command = [options.bin / "portolan_orb_time", sequence.folder]
    if sequence.frames:
        first, last = sequence.frames
        command += ["--first-frame", first, "--max-frames", last - first + 1]
    return float(run(command, log))


def measure(sequence, out, options, run_options, speed=None, run=run_command):
    """One run's figures by name. Raises CalledProcessError when a program failed."""
    out.mkdir(parents=True, exist_ok=True)
    log = out / "benchmark.log"
    command = [LAUNCHER, "--bin", options.bin, "--data", sequence.folder, "--out", out, "--speed", speed or options.speed, *run_options]
    if sequence.frames:
        first, last = sequence.frames
        command += ["--set", f"source.first_frame={first}", "--set", f"source.max_frames={last - first + 1}"]
    orb_ms = measure_orb(sequence, log, options, run)
    run(command, log)
    joined, maps = (evaluate(sequence.folder, out / f"{name}.txt", out / f"evaluation_{name}.json", options, sequence.frames, run)
                    for name in ("trajectory", "trajectory_maps"))
    summary = json.loads((out / "summary.json").read_text())
    return {**figures(summary, joined, maps, orb_ms), "revisits": revisits_closed(sequence, summary)}


def rmse(aligned):
    """Of one map of an evaluation; None when there were too few poses to align."""
    return aligned.get("ate", {}).get("rmse")


def figures(summary, joined, maps, orb_ms):
    """A run's row, unformatted. joined, maps: evaluations of both trajectories, or None. `poses` counts the trajectory's: a frame that was localised
    afterwards has one too."""
    frame_ms = summary["frame_ms"] or {}
    median_ms, p95_ms = frame_ms.get("median"), frame_ms.get("p95")  # null when no frame came
    largest = max(maps["maps"] if maps else (), key=lambda one: one["poses"], default={})
    return {
        "poses": joined["tracked"] if joined else summary["tracked"], "frames": joined["frames"] if joined else summary["frames"],
        "ate": rmse(joined["joined"]) if joined else None, "map_ate": rmse(largest),
        "maps": summary["maps"], "keyframes": summary["keyframes"],
        "median_ms": median_ms, "p95_ms": p95_ms, "orb_ms": orb_ms, "orb_ratio": median_ms / orb_ms if median_ms else None,
        "p95_ratio": p95_ms / median_ms if median_ms else None,
        "keyframe_ms": summary["stages_ms"].get(FRONTEND, {}).get("keyframe_to_delta", {}).get("median"),
        "cpu_s": sum(summary["cpu_s"].values()), "memory_mb": sum(summary["peak_memory_mb"].values()),
        "loop_closer_mb": summary["peak_memory_mb"].get(LOOP_CLOSER),
    }


def revisits_closed(sequence, summary):
    """How many of the places that are seen again a loop closed; None where it isn't known which are, or where maps were joined, which closes some."""
    revisits = REVISITS.get(sequence.name, ())
    if not revisits or summary["switches"] or summary["fusions"]:
        return None
    seconds = frame_seconds(sequence.folder)

    def is_in(stamp_ns, span):
        return seconds[max(0, span[0] - REVISIT_MARGIN)] <= stamp_ns * 1e-9 + 1e-4 and \
            stamp_ns * 1e-9 - 1e-4 <= seconds[min(len(seconds) - 1, span[1] + REVISIT_MARGIN)]

    applied = [closure for closure in summary["closures"] or () if closure["applied"]]
    return sum(any(is_in(closure["stamp_ns"], later) and is_in(closure["matched_stamp_ns"], earlier) for closure in applied) for later, earlier in revisits)


def tracked_cell(runs, limits):
    return beside(f"{show(median(runs, 'poses'), 0)} of {runs[0]['frames']}", limits, "poses")


def row(sequence, runs):
    """Cells of the table: the median of each figure over the runs that have it, beside the figure to meet."""
    limits, worked = LIMITS.get(sequence.name, ()), done(runs)
    if not worked:
        return [sequence.name, "failed", *[""] * (len(COLUMNS) - 3), verdict(limits, runs)]

    def cell(key, digits):
        return beside(show(median(worked, key), digits), limits, key)

    return [sequence.name, tracked_cell(worked, limits), cell("ate", 4), cell("map_ate", 4), cell("maps", 0), cell("keyframes", 0), cell("revisits", 0),
            cell("median_ms", 1), cell("p95_ms", 1), cell("orb_ms", 1), cell("orb_ratio", 2), cell("p95_ratio", 2), cell("keyframe_ms", 0), cell("cpu_s", 1),
            cell("memory_mb", 0), cell("loop_closer_mb", 0), verdict(limits, runs)]
