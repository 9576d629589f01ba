#!/usr/bin/env python3
"""Runs sequences through run.sh in real time, several times each, and prints the medians as a Markdown table beside the figures to meet.

Each run is compared with the time of cv::ORB on the same frames, measured just before it, because absolute times drift. Options that are not listed
go to run.sh, as --dds-mapper cyclonedds. Every run's results stay in the output folder.

  test/benchmark/benchmark.py                                                  all of ../shared/data, and blackout's frames 0-246 by themselves
  test/benchmark/benchmark.py --sequences blackout --frames 0-246 --runs 1
  test/benchmark/benchmark.py --compare                                        kitti_00 and kitchen on each DDS vendor, mixed, and in lockstep twice
  test/benchmark/benchmark.py --atlas                                          the runs of the atlas (atlas_runs.py), several robots among them
  test/benchmark/benchmark.py --atlas kitchen_cut kitchen_halves --runs 1
  test/benchmark/benchmark.py --report docs/figures.md                         and writes the table into that page; rows not made again stay

Exit code: 0 done, whatever the figures; 1 a run failed; 2 bad arguments.
"""

import argparse
import pathlib
import subprocess
import sys

import atlas_runs
import report_table
import sequence_runs
import vendor_runs
from figures_to_meet import done
from report_table import report_section

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
EXIT_FAILED, EXIT_USAGE = 1, 2
COMPARED = ("kitti_00", "kitchen")
NOTES = {
    "sequences": "Medians, and in brackets the figures to meet. Keyframe's way: from its publication to the first delta with it. MB: peaks of all processes "
                 "together.",
    "vendors": "Medians, and in brackets the least and the most. Met: an ATE within 15 % of lockstep's, and tracked, ATE, frame ms and CPU no farther from "
               "Fast DDS's than runs of one of the two differ, or than 10 % (tracked: 1 %).",
    "atlas": "Medians. The tracker's maps: in the order in which it was in them, by trajectory_online.txt (/: the second pass begins; a map that was fused "
             "counts as the one it went into). Switches and fusions: from the atlas_server's decision to their end.",
}


def introduce(what, options, run_options):
    """How and on what it is measured. The same words: rows of another day may stand beside these."""
    speed = "real time" if options.speed == "1" else f"speed {options.speed}"
    arguments = {"sequences": "", "vendors": " --compare", "atlas": " --atlas"}[what]
    given = f", run.sh with {' '.join(run_options)}" if run_options else ""
    return f"By `test/benchmark/benchmark.py{arguments}`, {speed}, on {report_table.cpu_model()}{given}. cv::ORB: median time of OpenCV's, 2000 features, " \
           f"on the same frames just before. {NOTES[what]}"


def make_report(what, columns, order, options, run_options):
    return report_table.Report(options.report, f"{what} (test/benchmark/benchmark.py)", introduce(what, options, run_options), columns, options.runs, order)


def choose_sequences(options, names=None):
    """What to measure: the sequences of these names, else all there are."""
    folders = [options.data / name for name in names or options.sequences or ()]
    for folder in folders:
        if not folder.is_dir():
            raise sequence_runs.UsageError(f"{folder}: no such sequence")
    folders = folders or sorted(folder for folder in options.data.iterdir() if sequence_runs.is_sequence(folder))
    if not folders:
        raise sequence_runs.UsageError(f"no sequence in {options.data}")
    if options.frames:
        return [sequence_runs.make_sequence(folder, options.frames) for folder in folders]
    if names or options.sequences:
        return [sequence_runs.make_sequence(folder) for folder in folders]
    return [sequence for folder in folders for sequence in sequence_runs.with_spans(folder)]


def attempt(sequence, out, options, run_options, speed=None):
    """One run's figures; of a run that fails, its failure."""
    try:
        return sequence_runs.measure(sequence, out, options, run_options, speed)
    except subprocess.CalledProcessError as error:
        print(f"{sequence.name}: {pathlib.Path(error.cmd[0]).name} ended with code {error.returncode}, see {out / 'benchmark.log'}", file=sys.stderr)
        return {"failure": error.returncode}
    except (OSError, ValueError, KeyError) as error:
        print(f"{sequence.name}: {out}: {error!r}", file=sys.stderr)
        return {"failure": str(error)}


def folder_of(sequence, options):
    return options.out / sequence.name.replace(", frames ", "_")


def measure_sequences(options, run_options):
    """Whether a run failed."""
    sequences, failed = choose_sequences(options), False
    report = make_report("sequences", sequence_runs.COLUMNS, sequence_runs.LIMITS, options, run_options)
    for sequence in sequences:
        runs = [attempt(sequence, folder_of(sequence, options) / str(number), options, run_options) for number in range(1, options.runs + 1)]
        failed = failed or len(done(runs)) < len(runs)
        report.add(sequence_runs.row(sequence, runs))
    return failed


def measure_vendors(options, run_options):
    sequences, failed = choose_sequences(options, options.compare or COMPARED), False
    report = make_report("vendors", vendor_runs.COLUMNS, vendor_runs.names(sequences), options, run_options)
    for sequence in sequences:
        for row, has_failed in vendor_runs.rows(sequence, options.out / "compare" / folder_of(sequence, options).name, options, run_options, attempt):
            failed = failed or has_failed
            report.add(row)
    return failed


def measure_atlas(options, run_options):
    runs, failed = atlas_runs.choose(options.atlas), False
    report = make_report("atlas", atlas_runs.COLUMNS, [run.name for run in atlas_runs.RUNS], options, run_options)
    folders = atlas_runs.prepare(runs, options.data, options.made)
    for run in runs:
        measured = []
        for number in range(1, options.runs + 1):
            try:
                measured.append(atlas_runs.measure(run, folders, options.out / run.name / str(number), options, run_options, sequence_runs.run_command))
            except (subprocess.CalledProcessError, OSError, ValueError, KeyError) as error:
                print(f"{run.name}: {error!r}", file=sys.stderr)
                measured.append({"failure": str(error)})
        failed = failed or len(done(measured)) < len(measured)
        report.add(atlas_runs.row(run, measured))
    return failed


def parse(arguments):
    parser = argparse.ArgumentParser(prog="benchmark.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    add = parser.add_argument
    add("--data", type=pathlib.Path, default=REPOSITORY.parent / "shared" / "data", help="folder of sequences (default: %(default)s)")
    add("--sequences", nargs="+", metavar="NAME", help="folders in it (default: all)")
    add("--frames", type=sequence_runs.parse_span, metavar="FIRST-LAST", help="only these frames of each sequence")
    add("--runs", type=int, default=3, help="runs of each sequence (default: %(default)s)")
    add("--speed", default="1", help="see run.sh (default: real time)")
    add("--out", type=pathlib.Path, default=REPOSITORY / "runs" / "benchmark", help="default: %(default)s")
    add("--bin", type=pathlib.Path, default=REPOSITORY / "install" / "bin", help="default: %(default)s")
    add("--compare", nargs="*", metavar="NAME", help=f"these sequences on each DDS vendor, mixed, and in lockstep twice (default: {', '.join(COMPARED)})")
    add("--atlas", nargs="*", metavar="RUN", help="the runs of the atlas, or these of them: " + ", ".join(run.name for run in atlas_runs.RUNS))
    add("--made", type=pathlib.Path, default=pathlib.Path("/tmp/portolan_sequences"),
        help="folder for the sequences that --atlas makes out of others (default: %(default)s)")
    add("--report", type=pathlib.Path, metavar="FILE", help="write the table into its section of this page, which is made if it is not there")
    options, run_options = parser.parse_known_args(arguments)
    if options.runs < 1:
        parser.error(f"--runs {options.runs}: expected 1 or more")
    if options.atlas is not None and options.compare is not None:
        parser.error("--atlas and --compare: one of them at a time")
    return options, run_options


def main(arguments):
    options, run_options = parse(arguments)
    measure = measure_atlas if options.atlas is not None else measure_vendors if options.compare is not None else measure_sequences
    try:
        return EXIT_FAILED if measure(options, run_options) else 0
    except (sequence_runs.UsageError, report_section.SectionError, atlas_runs.make_sequence.SequenceError) as error:
        print(f"benchmark.py: {error}", file=sys.stderr)
        return EXIT_USAGE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
