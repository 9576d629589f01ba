#!/usr/bin/env python3
"""Runs sequences through run.sh in real time, several times each, and prints the medians as a Markdown table.

Each run is compared with the time of cv::ORB on the same frames, measured just before it, because absolute times drift. Options that are not listed
go to run.sh, as --dds-mapper cyclonedds. Every run's results stay in the output folder.

  test/benchmark/benchmark.py                                                  all of ../shared/data
  test/benchmark/benchmark.py --sequences blackout --frames 0-246 --runs 1
  test/benchmark/benchmark.py --atlas                                          the runs of the atlas (atlas_runs.py), several robots among them
  test/benchmark/benchmark.py --atlas kitchen_cut kitchen_halves --runs 1
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys

import atlas_runs

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
# Where each layout has its ground truth: TUM, KITTI, EuRoC.
GROUND_TRUTHS = ("groundtruth.txt", "poses.txt", "mav0/state_groundtruth_estimate0/data.csv")
COLUMNS = ("sequence", "tracked", "ATE (m)", "maps", "keyframes", "frame ms", "p95 ms", "x ORB", "p95 / median", "CPU s", "MB")


def find_ground_truth(sequence):
    return next((sequence / name for name in GROUND_TRUTHS if (sequence / name).is_file()), None)


def parse_span(text):
    """"first-last" as two numbers."""
    first, dash, last = text.partition("-")
    if not (dash and first.isdigit() and last.isdigit() and int(first) <= int(last)):
        raise argparse.ArgumentTypeError(f"'{text}', expected FIRST-LAST as in 0-246")
    return int(first), int(last)


def run_command(command, log):
    """Standard output of a program; its standard error goes to the end of `log`. Raises CalledProcessError."""
    with open(log, "ab") as errors:
        return subprocess.run([str(part) for part in command], check=True, stdout=subprocess.PIPE, stderr=errors, text=True).stdout


def measure_once(sequence, out, options, run_options):
    """One run's figures by name. A run that fails has none but its failure."""
    out.mkdir(parents=True, exist_ok=True)
    log = out / "benchmark.log"
    orb_command = [options.bin / "portolan_orb_time", sequence]
    command = [REPOSITORY / "launch_scripts" / "run.sh", "--bin", options.bin, "--data", sequence, "--out", out, "--speed", options.speed,
               *run_options]
    evaluation = [options.bin / "portolan_eval", find_ground_truth(sequence), out / "trajectory.txt", "--json", out / "evaluation.json"]
    if options.frames:
        first, last = options.frames
        orb_command += ["--first-frame", first, "--max-frames", last - first + 1]
        command += ["--set", f"source.first_frame={first}", "--set", f"source.max_frames={last - first + 1}"]
        evaluation += ["--first-frame", first, "--last-frame", last]
    try:
        orb_ms = float(run_command(orb_command, log))
        run_command(command, log)
        run_command(evaluation, log)
    except subprocess.CalledProcessError as error:
        print(f"{sequence.name}: {pathlib.Path(error.cmd[0]).name} ended with code {error.returncode}, see {log}", file=sys.stderr)
        return {"failure": error.returncode}
    summary = json.loads((out / "summary.json").read_text())
    return figures(summary, json.loads((out / "evaluation.json").read_text()), orb_ms)


def figures(summary, evaluation, orb_ms):
    """A run's row, unformatted. `poses` counts the trajectory's: a frame that was localised afterwards has one too."""
    frame_ms = summary["frame_ms"]
    return {
        "poses": evaluation["tracked"], "frames": evaluation["frames"],
        "ate": evaluation["joined"].get("ate", {}).get("rmse"),  # none when there were too few poses to align
        "maps": summary["maps"], "keyframes": summary["keyframes"],
        "median_ms": frame_ms["median"], "p95_ms": frame_ms["p95"], "orb_ratio": frame_ms["median"] / orb_ms,
        "p95_ratio": frame_ms["p95"] / frame_ms["median"],
        "cpu_s": sum(summary["cpu_s"].values()), "memory_mb": sum(summary["peak_memory_mb"].values()),
    }


def median_row(name, runs):
    """A line of the table: the median of each figure over the runs that have it."""
    done = [run for run in runs if "failure" not in run]
    if not done:
        return f"| {name} | failed |" + " |" * (len(COLUMNS) - 2)

    def median(key, digits):
        values = [run[key] for run in done if run[key] is not None]
        return f"{statistics.median(values):.{digits}f}" if values else "-"

    label = name if len(done) == len(runs) else f"{name} ({len(runs) - len(done)} of {len(runs)} runs failed)"
    share = statistics.median(run["poses"] / run["frames"] for run in done)
    cells = [label, f"{median('poses', 0)} of {done[0]['frames']} ({100 * share:.1f} %)", median("ate", 4), median("maps", 0), median("keyframes", 0),
             median("median_ms", 1), median("p95_ms", 1), median("orb_ratio", 2), median("p95_ratio", 2), median("cpu_s", 1),
             median("memory_mb", 0)]
    return "| " + " | ".join(cells) + " |"


def choose_sequences(options):
    if options.sequences:
        chosen = [options.data / name for name in options.sequences]
    else:
        chosen = sorted(folder for folder in options.data.iterdir() if find_ground_truth(folder))
    for sequence in chosen:
        if find_ground_truth(sequence) is None:
            sys.exit(f"benchmark.py: {sequence} has no ground truth ({', '.join(GROUND_TRUTHS)})")
    if not chosen:
        sys.exit(f"benchmark.py: no sequence with a ground truth in {options.data}")
    return chosen


def print_head(columns):
    print("| " + " | ".join(columns) + " |\n" + "|" + " --- |" * len(columns), flush=True)


def measure_atlas(options, run_options):
    """Prints the table of the atlas's runs. Returns whether one failed."""
    runs = atlas_runs.choose(options.atlas)
    folders = atlas_runs.prepare(runs, options.data, options.made)
    options.launcher = REPOSITORY / "launch_scripts" / "run.sh"
    print_head(atlas_runs.COLUMNS)
    failed = False
    for run in runs:
        measured = []
        for number in range(1, options.runs + 1):
            try:
                measured.append(atlas_runs.measure(run, folders, options.out / run.name / str(number), options, run_options, run_command))
            except (subprocess.CalledProcessError, OSError, KeyError) as error:
                print(f"{run.name}: {error}", file=sys.stderr)
                measured.append({"failure": str(error)})
        failed = failed or any("failure" in figures_of_run for figures_of_run in measured)
        print(atlas_runs.row(run, measured), flush=True)
    return failed


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    parser.add_argument("--data", type=pathlib.Path, default=REPOSITORY.parent / "shared" / "data", help="folder of sequences (default: %(default)s)")
    parser.add_argument("--sequences", nargs="+", metavar="NAME", help="folders in it (default: all with a ground truth)")
    parser.add_argument("--frames", type=parse_span, metavar="FIRST-LAST", help="only these frames of each sequence")
    parser.add_argument("--runs", type=int, default=3, help="runs of each sequence (default: %(default)s)")
    parser.add_argument("--speed", default="1", help="see run.sh (default: real time)")
    parser.add_argument("--out", type=pathlib.Path, default=REPOSITORY / "runs" / "benchmark", help="default: %(default)s")
    parser.add_argument("--bin", type=pathlib.Path, default=REPOSITORY / "install" / "bin", help="default: %(default)s")
    parser.add_argument("--atlas", nargs="*", metavar="RUN", help="the runs of the atlas, or these of them: " + ", ".join(run.name for run in atlas_runs.RUNS))
    parser.add_argument("--made", type=pathlib.Path, default=pathlib.Path("/tmp/portolan_sequences"),
                        help="folder for the sequences that --atlas makes out of others (default: %(default)s)")
    options, run_options = parser.parse_known_args(arguments)
    if options.atlas is not None:
        return 1 if measure_atlas(options, run_options) else 0
    sequences = choose_sequences(options)
    print_head(COLUMNS)
    failed = False
    for sequence in sequences:
        runs = [measure_once(sequence, options.out / sequence.name / str(number), options, run_options) for number in range(1, options.runs + 1)]
        failed = failed or any("failure" in run for run in runs)
        print(median_row(sequence.name, runs), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
