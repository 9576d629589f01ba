"""The same run on both DDS vendors, mixed, and in lockstep, side by side. For benchmark.py --compare."""

import itertools

import sequence_runs
from figures_to_meet import done, median, show

REAL_TIME = (
    ("Fast DDS", ("--dds", "fastdds")),
    ("Cyclone DDS", ("--dds", "cyclonedds")),
    ("mapper on Cyclone DDS", ("--dds", "fastdds", "--dds-mapper", "cyclonedds")),
)
LOCKSTEP, LOCKSTEP_RUNS = "lockstep", 2
# "within noise of each other": medians no farther apart than the runs of one of the two, or than this share.
COMPARED = (("poses", "tracked", 0.01), ("ate", "ATE", 0.1), ("median_ms", "frame ms", 0.1), ("cpu_s", "CPU", 0.1))
MAX_OF_LOCKSTEP = 1.15
COLUMNS = ("run", "tracked", "ATE (m)", "of lockstep", "frame ms", "cv::ORB ms", "x ORB", "p95 / median", "keyframe's way (ms)", "CPU s", "MB", "verdict")


def names(sequences):
    """First cells of all rows, in order."""
    return [f"{sequence.name}, {setup}" for sequence in sequences for setup in (LOCKSTEP, *(name for name, _ in REAL_TIME))]


def measure(sequence, out, options, run_options, attempt):
    """[(setup, runs, whether lockstep's trajectories are the same)]. attempt: does sequence_runs.measure and notes a failure."""
    def runs_of(setup, settings, number, speed):
        folders = [out / setup.replace(" ", "_") / str(i) for i in range(1, number + 1)]
        return folders, [attempt(sequence, folder, options, [*settings, *run_options], speed) for folder in folders]

    folders, runs = runs_of(LOCKSTEP, REAL_TIME[0][1], LOCKSTEP_RUNS, LOCKSTEP)
    yield LOCKSTEP, runs, None if len(done(runs)) < LOCKSTEP_RUNS else difference(*(folder / "trajectory.txt" for folder in folders))
    for setup, settings in REAL_TIME:
        yield setup, runs_of(setup, settings, options.runs, None)[1], None


def difference(one, other):
    """In words, of two trajectories byte by byte."""
    first, second = one.read_bytes(), other.read_bytes()
    if first == second:
        return "byte-equal" if first.strip() else "no poses to compare"
    lines = itertools.zip_longest(first.splitlines(keepends=True), second.splitlines(keepends=True))
    return f"differ from line {next(i for i, (a, b) in enumerate(lines, start=1) if a != b)} on"


def is_apart(key, share, runs, others):
    """Whether a figure of some runs and of others differs by more than noise; one that only one of them has does."""
    a, b = median(runs, key), median(others, key)
    if a is None or b is None:
        return (a is None) != (b is None)
    spreads = [max(values) - min(values) for values in ([run[key] for run in some if run[key] is not None] for some in (runs, others))]
    return abs(a - b) > max(*spreads, share * min(abs(a), abs(b)))


def of_lockstep(runs, lockstep):
    """The ATE as a share of lockstep's; None if one of them is not known."""
    ate, reference = median(runs, "ate"), median(lockstep, "ate")
    return ate / reference if ate is not None and reference else None


def judge(runs, lockstep, reference):
    """Why runs in real time are not as they should be: against lockstep, and against those of the first vendor (None: they are these)."""
    share = of_lockstep(runs, lockstep)
    problems = [] if share is not None and share <= MAX_OF_LOCKSTEP else ["ATE to lockstep's"]
    return problems + [f"{words} to {REAL_TIME[0][0]}'s" for key, words, noise in COMPARED if reference and is_apart(key, noise, runs, reference)]


def spread(runs, key, digits):
    """Median and, of several runs that differ, the least and the most."""
    values = [run[key] for run in runs if run[key] is not None]
    text = show(median(runs, key), digits)
    return f"{text} ({min(values):.{digits}f} to {max(values):.{digits}f})" if len(values) > 1 and min(values) < max(values) else text


def row(sequence, setup, runs, is_same, lockstep, reference):
    """Cells of the table. is_same: what difference() said, for lockstep; reference: runs of the first vendor, None for these themselves."""
    name, worked = f"{sequence.name}, {setup}", done(runs)
    failed = [f"{len(runs) - len(worked)} of {len(runs)} runs failed"] if len(worked) < len(runs) else []
    if not worked:
        return [name, "failed", *[""] * (len(COLUMNS) - 3), failed[0]]
    if setup == LOCKSTEP:
        words, share = [is_same] if is_same else [], "-"
    else:
        problems = judge(worked, done(lockstep), done(reference) if reference is not None else None)
        words = ["apart: " + ", ".join(problems)] if problems else ["met"]
        ratio = of_lockstep(worked, done(lockstep))
        share = "-" if ratio is None else f"{100 * ratio:.0f} % (≤ {100 * MAX_OF_LOCKSTEP:.0f} %)"
    return [name, sequence_runs.tracked_cell(worked, ()), spread(worked, "ate", 4), share, spread(worked, "median_ms", 1), show(median(worked, "orb_ms"), 1),
            spread(worked, "orb_ratio", 2), spread(worked, "p95_ratio", 2), spread(worked, "keyframe_ms", 0), spread(worked, "cpu_s", 1),
            spread(worked, "memory_mb", 0), "; ".join(words + failed)]


def rows(sequence, out, options, run_options, attempt):
    """(row, whether a run failed) as they come."""
    lockstep = reference = None
    for setup, runs, is_same in measure(sequence, out, options, run_options, attempt):
        lockstep = runs if setup == LOCKSTEP else lockstep
        yield row(sequence, setup, runs, is_same, lockstep, reference), len(done(runs)) < len(runs)
        reference = runs if setup == REAL_TIME[0][0] else reference
