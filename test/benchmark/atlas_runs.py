"""The runs by which the atlas is judged: many maps, switched, fused and kept; several robots with one atlas_server. For benchmark.py --atlas.

Each is made of sequences of the data folder or of make_sequence.py's, and stands in the table beside the figures to meet and ORB-SLAM3's on the
same frames.
"""

import collections
import json
import pathlib
import statistics
import sys

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "sequences"))
import make_sequence  # noqa: E402

# sequences: one for each robot; truth: the sequence whose ground truth all of them are compared with, in one frame; settings: --set of run.sh;
# offset: seconds between two robots' starts; speed: None: the benchmark's.
Run = collections.namedtuple("Run", "name sequences truth settings offset speed to_meet orb_slam3")

SMALL_MAPS = ("tracker.max_map_keyframes=120",)
QUARTERS = tuple(f"kitchen_quarter_{i}" for i in (1, 2, 3, 4))
RUNS = (
    Run("blackout", ("blackout",), "blackout", (), 0, None, "730 of 761; one map or a linked pair; joined 0.10", "706, one merge, 0.327"),
    Run("office_walk", ("office_walk",), "office_walk", (), 0, None, "300 of 373; per map 0.15, joined 0.4",
        "232 in 4 maps, per map 0.216, joined 2.33"),
    Run("halls", ("halls",), "halls", (), 0, None, "1020 of 1070; one map or linked ones; joined 0.12", "968; joined 0.19 once, 5.9 twice"),
    Run("kitchen_cut", ("kitchen_cut",), "kitchen_cut", (), 0, None, "1175 of 1200 with texture; one map or linked ones; joined 0.041",
        "1167, new map after 91 lost frames, merged, 0.041"),
    Run("town_lap", ("town_lap",), "town_lap", SMALL_MAPS, 0, None, "three maps or more, switches back, none new in lap 2; per map 3", ""),
    Run("town_lap_twice", ("town_lap_twice",), "town_lap_twice", SMALL_MAPS, 0, None, "second pass: the same switches, under 10 % more keyframes", ""),
    Run("kitchen_halves", ("kitchen_first_half", "kitchen_second_half"), "kitchen", (), 0, None, "one map; both in its frame 0.05", ""),
    Run("kitchen_even_odd", ("kitchen_even", "kitchen_odd"), "kitchen", (), 5, None, "one map; both in its frame 0.05", ""),
    Run("kitchen_quarters", QUARTERS, "kitchen", (), 0, "lockstep", "works", ""),
)
COLUMNS = ("run", "tracked", "joined ATE (m)", "per-map ATE (m)", "maps at the end", "switches", "fusions", "keyframes", "2nd pass", "MB / CPU s by robot",
           "to meet", "ORB-SLAM3")


def choose(names):
    """The runs of these names; all if none are given."""
    known = {run.name: run for run in RUNS}
    for name in names:
        if name not in known:
            sys.exit(f"benchmark.py: --atlas {name}: expected some of {', '.join(known)}")
    return [known[name] for name in names] or list(RUNS)


def prepare(runs, data, made):
    """Folders of all sequences, {name: path}; those that are made of others are made."""
    names = {name for run in runs for name in (*run.sequences, run.truth)}
    make_sequence.make_named(data, made, sorted(name for name in names if name in make_sequence.NAMED))
    return {name: (made if name in make_sequence.NAMED else data) / name for name in names}


def command_of(run, folders, out, speed):
    """The options of run.sh."""
    command = ["--out", out, "--speed", run.speed or speed]
    for name in run.sequences:
        command += ["--data", folders[name]]
    for setting in run.settings:
        command += ["--set", setting]
    if len(run.sequences) > 1:
        command += ["--robots", len(run.sequences), "--start-offset", run.offset]
    return command


def robot_folders(run, out):
    return [out] if len(run.sequences) == 1 else [out / f"robot_{number}" for number in range(len(run.sequences))]


def join_trajectories(paths, joined):
    """All robots' poses in one file, in the order of time."""
    lines = {}
    for path in paths:
        for line in path.read_text().splitlines():
            if line and not line.startswith("#"):
                lines.setdefault(float(line.split()[0]), line)
    joined.write_text("".join(lines[stamp] + "\n" for stamp in sorted(lines)))


def second_pass_share(folder, sequence):
    """Keyframes of the second half of a sequence, as a share of those of the first; None when there are none."""
    times = [float(line.split()[0]) for line in (sequence / "rgb.txt").read_text().splitlines() if not line.startswith("#")]
    middle = times[len(times) // 2]
    stamps = [float(line.split()[0]) for line in (folder / "keyframes.txt").read_text().splitlines() if not line.startswith("#")]
    first = sum(stamp < middle for stamp in stamps)
    return (len(stamps) - first) / first if first else None


def figures(summary, atlas, evaluation, per_map, second_pass):
    """One run's row, unformatted. @param per_map the evaluation of the maps each by itself; None for several robots."""
    robots = list(summary["robots"].values()) if "robots" in summary else [summary]
    return {
        "poses": evaluation["tracked"], "frames": evaluation["frames"],
        "joined": evaluation["joined"].get("ate", {}).get("rmse"),
        "per_map": None if per_map is None else per_map["maps_combined"]["rmse"] if per_map["maps"] else None,
        "maps": atlas["maps"], "keyframes": atlas["keyframes"],
        "switches": sum(robot["switches"] or 0 for robot in robots), "fusions": sum(robot["fusions"] or 0 for robot in robots),
        "second_pass": second_pass,
        "memory_mb": [sum(robot["peak_memory_mb"].values()) for robot in robots], "cpu_s": [sum(robot["cpu_s"].values()) for robot in robots],
    }


def measure(run, folders, out, options, run_options, run_command):
    """Runs it once. Raises CalledProcessError when a program failed."""
    out.mkdir(parents=True, exist_ok=True)
    log = out / "benchmark.log"
    run_command([options.launcher, "--bin", options.bin, *command_of(run, folders, out, options.speed), *run_options], log)
    truth, robots = folders[run.truth], robot_folders(run, out)
    truth_file = next(truth / name for name in ("groundtruth.txt", "poses.txt") if (truth / name).is_file())

    def evaluate(trajectory, name):
        run_command([options.bin / "portolan_eval", truth_file, trajectory, "--json", out / name], log)
        return json.loads((out / name).read_text())

    joined, per_map = out / "joined.txt", None
    join_trajectories([folder / "trajectory.txt" for folder in robots], joined)
    if len(robots) == 1:
        per_map = evaluate(out / "trajectory_maps.txt", "evaluation_maps.json")
    second_pass = second_pass_share(out, folders[run.sequences[0]]) if run.name == "town_lap_twice" else None
    summary, atlas = (json.loads((out / name).read_text()) for name in ("summary.json", "atlas_server.json"))
    return figures(summary, atlas, evaluate(joined, "evaluation.json"), per_map, second_pass)


def median_of(values, digits):
    known = [value for value in values if value is not None]
    return f"{statistics.median(known):.{digits}f}" if known else "-"


def row(run, measured):
    """A line of the table: the median of each figure over the runs that came to their end."""
    done = [figures for figures in measured if "failure" not in figures]
    if not done:
        cells = [f"{run.name}", "failed", *[""] * (len(COLUMNS) - 4), run.to_meet, run.orb_slam3]
        return "| " + " | ".join(cells) + " |"
    robots = range(len(done[0]["memory_mb"]))
    use = ", ".join(f"{median_of([d['memory_mb'][i] for d in done], 0)} / {median_of([d['cpu_s'][i] for d in done], 0)}" for i in robots)
    share = median_of([None if d["second_pass"] is None else 100 * d["second_pass"] for d in done], 0)
    label = run.name if len(done) == len(measured) else f"{run.name} ({len(measured) - len(done)} of {len(measured)} runs failed)"
    cells = [label, f"{median_of([d['poses'] for d in done], 0)} of {done[0]['frames']}", median_of([d["joined"] for d in done], 3),
             median_of([d["per_map"] for d in done], 3), *(median_of([d[key] for d in done], 0) for key in ("maps", "switches", "fusions", "keyframes")),
             share if share == "-" else f"{share} %", use, run.to_meet, run.orb_slam3]
    return "| " + " | ".join(cells) + " |"
