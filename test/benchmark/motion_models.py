#!/usr/bin/env python3
"""The paper's Table 2, redone: how many maps come of a sequence with each way of predicting the camera's pose.

Each run is tracker, mapper and loop closer in one process and in lockstep (portolan_pipeline_run), so that it is the same on every machine and under any load; the
runs of a cell begin at the first frame, the second and so on. Sequences are taken whole and at double speed (every second frame). Fewer maps are better: a new one begins when the camera is lost.

  test/benchmark/motion_models.py                                 all of ../shared/data, ten runs each: hours
  test/benchmark/motion_models.py --sequences kitchen --runs 3 --jobs 2
"""

import argparse
import concurrent.futures
import pathlib
import re
import statistics
import sys
import tempfile

import pipeline_run

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
MODELS = {
    "constant velocity": ("tracker.use_esm=false", "tracker.decaying_velocity=false"),
    "decaying velocity": ("tracker.use_esm=false",),
    "decaying velocity and ESM": (),
}
SUMMARY = re.compile(r"^frames (\d+) online (\d+) .*\nmaps (\d+) ", re.MULTILINE)


def parse_summary(text):
    """(frames, tracked, maps) of what portolan_pipeline_run prints; ValueError if it is not there."""
    found = SUMMARY.search(text)
    if not found:
        raise ValueError("portolan_pipeline_run printed no summary")
    return tuple(int(number) for number in found.groups())


def run_once(program, sequence, every, model, first_frame):
    with tempfile.TemporaryDirectory(prefix="motion_models_") as out:
        return parse_summary(pipeline_run.run(program, sequence, out, MODELS[model], "--every", every, "--first", first_frame))


def cell(outcomes):
    """Mean number of maps, and of frames that were tracked."""
    frames = max(frames for frames, _, _ in outcomes)
    return f"{statistics.fmean(maps for _, _, maps in outcomes):.1f} ({statistics.fmean(tracked for _, tracked, _ in outcomes):.0f} of {frames})"


def table(results, runs):
    """Markdown; results by (sequence, every), then model."""
    lines = [f"Maps, and frames tracked; means of {runs} runs.", "", "| sequence | " + " | ".join(MODELS) + " |", "| --- |" + " --- |" * len(MODELS)]
    for (sequence, every), by_model in results.items():
        name = sequence if every == 1 else f"{sequence}, every second frame"
        lines.append(f"| {name} | " + " | ".join(cell(by_model[model]) for model in MODELS) + " |")
    means = [statistics.fmean(maps for by_model in results.values() for _, _, maps in by_model[model]) for model in MODELS]
    lines.append("| mean | " + " | ".join(f"{mean:.2f}" for mean in means) + " |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, default=REPOSITORY.parent / "shared" / "data", help="folder of sequences (default: %(default)s)")
    parser.add_argument("--sequences", nargs="+", help="some of them (default: all that have ground truth)")
    parser.add_argument("--runs", type=int, default=10, help="of each cell (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time (default: %(default)s)")
    parser.add_argument("--program", type=pathlib.Path, default=REPOSITORY / "install" / "bin" / "portolan_pipeline_run")
    options = parser.parse_args()
    if not options.program.is_file():
        parser.error(f"{options.program} is not there: build first (launch_scripts/build.sh)")
    names = options.sequences or sorted(path.parent.name for pattern in ("*/groundtruth.txt", "*/poses.txt") for path in options.data.glob(pattern))
    missing = [name for name in names if not (options.data / name).is_dir()]
    if missing or not names or options.runs < 1 or options.jobs < 1:
        parser.error(f"no sequence {missing[0] if missing else 'with ground truth'} in {options.data}" if missing or not names else "--runs and --jobs: expected 1 or more")

    results = {(name, every): {} for name in names for every in (1, 2)}
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        for (name, every), by_model in results.items():
            for model in MODELS:
                futures = [pool.submit(run_once, options.program, options.data / name, every, model, first) for first in range(options.runs)]
                by_model[model] = [future.result() for future in futures]
                print(f"{name}, every {every}, {model}: {cell(by_model[model])}", file=sys.stderr, flush=True)
    print(table(results, options.runs))


if __name__ == "__main__":
    main()
