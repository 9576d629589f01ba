"""The runs by which the atlas is judged: many maps, switched, fused and kept; several robots with one atlas_server. For benchmark.py --atlas.

Each is made of sequences of the data folder or of make_sequence.py's, and stands in the table beside the figures to meet and ORB-SLAM3's on the
same frames.
"""

import collections
import json
import pathlib
import sys

import map_order
import sequence_runs
from figures_to_meet import at_least, at_most, beside, done, list_limits, median, show, verdict

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "sequences"))
import make_sequence  # noqa: E402

# sequences: one for each robot; truth: the sequence whose ground truth all of them are compared with, in one frame; settings: --set of run.sh;
# offset: seconds between two robots' starts; speed: None: the benchmark's; limits: what is to be met, besides FOR_ALL.
Run = collections.namedtuple("Run", "name sequences truth settings offset speed limits orb_slam3")

SMALL_MAPS = ("tracker.max_map_keyframes=120",)
QUARTERS = tuple(f"kitchen_quarter_{i}" for i in (1, 2, 3, 4))
TOWN_LAP_FRAMES, SECOND_LAP = 1138, 865  # of town_lap; its frames from 865 on see those from 0 on (shared/data/README.md)
FOR_ALL = (at_most("to_new_map", "frames to a new map", 15, is_optional=True), at_most("switch_s", "switch", 0.3, is_optional=True),
           at_most("kb_per_keyframe", "kB a keyframe", 120))


def is_so(key, words):
    """Of a figure that is 0 or 1: met when it is 1 in most runs."""
    return at_least(key, words, 1, is_worded=True)


def tracked(poses):
    return at_least("poses", "tracked", poses)


def joined(ate):
    return at_most("joined", "joined ATE", ate)


def per_map(ate):
    return at_most("worst_map", "ATE of each map", ate)


LINKED = is_so("is_linked", "one map or linked ones")
ONE_FRAME = (at_most("maps", "one map", 1, is_worded=True), joined(0.05))
RUNS = (
    Run("blackout", ("blackout",), "blackout", (), 0, None,
        (tracked(730), at_least("joins", "fusion or switch on the return", 1, is_worded=True), at_most("maps", "two maps at most", 2, is_worded=True),
         LINKED, joined(0.1)),
        "706, one merge, 0.327"),
    Run("office_walk", ("office_walk",), "office_walk", (), 0, None, (tracked(300), per_map(0.15), joined(0.4)), "232 in 4 maps, per map 0.216, joined 2.33"),
    Run("halls", ("halls",), "halls", (), 0, None, (tracked(1020), LINKED, joined(0.12)), "968; joined 0.19 once, 5.9 twice"),
    Run("kitchen_cut", ("kitchen_cut",), "kitchen_cut", (), 0, None, (tracked(1175), LINKED, joined(0.041)),
        "1167, new map after 91 lost frames, merged, 0.041"),
    Run("town_lap", ("town_lap",), "town_lap", SMALL_MAPS, 0, None,
        (at_least("maps", "three maps or more", 3, is_worded=True), is_so("returns", "back to the first map in lap 2"),
         at_most("new_in_lap_2", "none begun in lap 2", 0, is_worded=True), per_map(3)), ""),
    Run("town_lap_twice", ("town_lap_twice",), "town_lap_twice", SMALL_MAPS, 0, None,
        (is_so("same_switches", "the second pass makes the same switches"),
         at_most("second_pass", "it adds less than 10 % keyframes", 0.1, is_worded=True)), ""),
    Run("kitchen_halves", ("kitchen_first_half", "kitchen_second_half"), "kitchen", (), 0, None, ONE_FRAME, ""),
    Run("kitchen_even_odd", ("kitchen_even", "kitchen_odd"), "kitchen", (), 5, None, ONE_FRAME, ""),
    Run("kitchen_quarters", QUARTERS, "kitchen", (), 0, "lockstep", (is_so("all_tracked", "every robot tracks"),), ""),
)
COLUMNS = ("run", "tracked of those with texture", "joined ATE (m)", "worst map's ATE (m)", "maps at the end", "links", "unlinked maps", "the tracker's maps",
           "switches", "longest switch (s)", "fusions", "longest fusion (s)", "frames to a new map, with texture", "keyframes", "2nd pass adds",
           "kB a keyframe", "cv::ORB ms", "MB / CPU s by robot", "to meet", "ORB-SLAM3", "verdict")


def choose(names):
    """The runs of these names; all if none are given."""
    known = {run.name: run for run in RUNS}
    for name in names:
        if name not in known:
            raise sequence_runs.UsageError(f"--atlas {name}: expected some of {', '.join(known)}")
    return [known[name] for name in names] or list(RUNS)


def prepare(runs, data, made):
    """Folders of all sequences, {name: path}; those that are made of others are made."""
    names = {name for run in runs for name in (*run.sequences, run.truth)}
    named = sorted(name for name in names if name in make_sequence.NAMED)
    if named:  # none would be all
        make_sequence.make_named(data, made, named)
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


def join_trajectories(paths, target):
    """All robots' poses in one file, in the order of time."""
    lines = {}
    for path in paths:
        for line in path.read_text().splitlines() if path.is_file() else ():
            if line and not line.startswith("#"):
                lines.setdefault(float(line.split()[0]), line)
    target.write_text("".join(lines[stamp] + "\n" for stamp in sorted(lines)))


def second_pass_share(folder, sequence):
    """Keyframes of the second half of a sequence, as a share of those of the first; None when there are none."""
    times = sequence_runs.frame_seconds(sequence)
    middle = times[len(times) // 2]
    stamps = [float(line.split()[0]) for line in (folder / "keyframes.txt").read_text().splitlines() if not line.startswith("#")]
    first = sum(stamp < middle for stamp in stamps)
    return (len(stamps) - first) / first if first else None


def store_bytes(out):
    """Of the atlas's file with what its log has not yet given it."""
    return sum(path.stat().st_size for path in (out / "atlas.db", out / "atlas.db-wal") if path.is_file())


def longest(atlas, kind):
    """Seconds from the decision to its end, of the joins of a kind that came to be; None without any."""
    return max((join["seconds"] for join in atlas["joins"] if join["kind"] == kind and join["done"]), default=None)


def total(robots, key):
    return sum(robot[key] or 0 for robot in robots)


def figures(summary, atlas, evaluation, maps):
    """One run's row, unformatted, as far as the reports tell. @param maps the evaluation of the maps each by itself; None for several robots."""
    robots = list(summary["robots"].values()) if "robots" in summary else [summary]
    switches, fusions, unlinked = (total(robots, key) for key in ("switches", "fusions", "unlinked_maps"))
    return {
        "joined": sequence_runs.rmse(evaluation["joined"]) if evaluation else None,
        "worst_map": max((ate for ate in map(sequence_runs.rmse, maps["maps"] if maps else ()) if ate is not None), default=None),
        "maps": atlas["maps"], "keyframes": atlas["keyframes"], "links": total(robots, "links"), "unlinked": unlinked,
        "is_linked": int(atlas["maps"] == 1 or unlinked == 0),
        "switches": switches, "fusions": fusions, "joins": switches + fusions,
        "switch_s": longest(atlas, "switch"), "fusion_s": longest(atlas, "fusion"),
        "memory_mb": [sum(robot["peak_memory_mb"].values()) for robot in robots], "cpu_s": [sum(robot["cpu_s"].values()) for robot in robots],
    }


def follow(run, summary, sequences, folders):
    """What the trajectories tell. @param sequences map_order.Frames of each robot, whose results are in `folders`."""
    robots = list(summary["robots"].values()) if "robots" in summary else [summary]
    poses = [frames.textured(folder / "trajectory.txt") for frames, folder in zip(sequences, folders)]
    visits = [frames.visits(folder / "trajectory_online.txt") for frames, folder in zip(sequences, folders)]
    lost = [map_order.textured_frames_to_new_map(robot["frames_to_new_map"] or [], len(frames.black)) for robot, frames in zip(robots, sequences)]
    found = {
        "poses": sum(poses), "frames": sum(frames.num_textured() for frames in sequences), "all_tracked": int(all(poses)),
        "order": ", ".join(map(map_order.in_words, visits)), "to_new_map": max((value for value in lost if value is not None), default=None),
    }
    if run.name == "town_lap":
        # A map that was fused may have been begun anywhere; one that was begun in lap 2 mostly is, into the map of lap 1.
        found["returns"] = int(map_order.returns_to_first(visits[0], SECOND_LAP))
        found["new_in_lap_2"] = len(map_order.begun_from(visits[0], SECOND_LAP)) + total(robots, "fusions")
    if run.name == "town_lap_twice":
        online = folders[0] / "trajectory_online.txt"
        passes = [map_order.in_words(sequences[0].visits(online, *span)) for span in ((0, TOWN_LAP_FRAMES - 1), (TOWN_LAP_FRAMES,))]
        found["order"] = " / ".join(passes)
        found["same_switches"] = int(passes[0] == passes[1] != "-")
    return found


def measure(run, folders, out, options, run_options, run_command):
    """Runs it once. Raises CalledProcessError when a program failed."""
    out.mkdir(parents=True, exist_ok=True)
    log = out / "benchmark.log"
    orb_ms = sequence_runs.measure_orb(sequence_runs.make_sequence(folders[run.sequences[0]]), log, options, run_command)
    run_command([sequence_runs.LAUNCHER, "--bin", options.bin, *command_of(run, folders, out, options.speed), *run_options], log)
    results = robot_folders(run, out)
    joined_file = out / "joined.txt"
    join_trajectories([folder / "trajectory.txt" for folder in results], joined_file)

    def evaluate(trajectory, name):
        return sequence_runs.evaluate(folders[run.truth], trajectory, out / name, options, run=run_command)

    summary, atlas = (json.loads((out / name).read_text()) for name in ("summary.json", "atlas_server.json"))
    maps = evaluate(out / "trajectory_maps.txt", "evaluation_maps.json") if len(results) == 1 else None
    sequences = [map_order.Frames(folders[name]) for name in run.sequences]
    return {
        **figures(summary, atlas, evaluate(joined_file, "evaluation.json"), maps),
        **follow(run, summary, sequences, results),
        "orb_ms": orb_ms,
        "second_pass": second_pass_share(out, folders[run.sequences[0]]) if run.name == "town_lap_twice" else None,
        "kb_per_keyframe": store_bytes(out) / 1e3 / atlas["stored_keyframes"] if atlas["stored_keyframes"] else None,
    }


def limits_of(run):
    """All that a run is to meet; in lockstep there is no time to keep."""
    return (*run.limits, *(limit for limit in FOR_ALL if not (run.speed == "lockstep" and limit.key == "switch_s")))


def row(run, measured):
    """Cells of the table: the median of each figure over the runs that came to their end."""
    limits, worked = limits_of(run), done(measured)
    last = [list_limits(run.limits), run.orb_slam3, verdict(limits, measured)]
    if not worked:
        return [run.name, "failed", *[""] * (len(COLUMNS) - 2 - len(last)), *last]

    def cell(key, digits):
        return beside(show(median(worked, key), digits), [limit for limit in limits if limit in FOR_ALL], key)

    def of_robot(key, i):
        return show(median([{key: one[key][i]} for one in worked], key), 0)

    use = ", ".join(f"{of_robot('memory_mb', i)} / {of_robot('cpu_s', i)}" for i in range(len(run.sequences)))
    orders = "; ".join(dict.fromkeys(one["order"] for one in worked))  # it has no median: each that was
    share = median(worked, "second_pass")
    return [run.name, f"{cell('poses', 0)} of {worked[0]['frames']}", cell("joined", 3), cell("worst_map", 3), cell("maps", 0), cell("links", 0),
            cell("unlinked", 0), orders, cell("switches", 0), cell("switch_s", 2), cell("fusions", 0), cell("fusion_s", 2), cell("to_new_map", 0),
            cell("keyframes", 0), "-" if share is None else f"{100 * share:.0f} %", cell("kb_per_keyframe", 0), cell("orb_ms", 1), use, *last]
