"""Merges what the processes left in OUT into summary.json."""

import json
import os

from launch_arguments import FRONTEND

# Figures of the run that the frontend knows; null if it left none.
FRONTEND_KEYS = ("frames", "tracked", "dropped", "lost", "maps", "keyframes", "points", "links", "unlinked_maps", "switches", "fusions",
                 "refused_moves", "frames_to_new_map", "frame_ms", "lens_residual", "bytes_per_keyframe", "keyframes_sent", "keyframes_sent_again",
                 "keyframes_unacknowledged", "keyframes_given_up")
# What the loop_closer found; null if it left no figures.
LOOP_KEYS = ("loops", "closures", "refusals", "loop_counters")
# Figures that each process has of its own.
PROCESS_KEYS = ("stages_ms", "peak_memory_mb", "cpu_s", "dds", "priority", "build", "counters")


def read_reports(out, roles):
    """What each process wrote at its end: {role: JSON object}, and messages on those which left none."""
    reports, problems = {}, []
    for role in roles:
        path = out / f"{role}.json"
        try:
            report = json.loads(path.read_text())
            if not isinstance(report, dict):
                raise ValueError("expected a JSON object")
            reports[role] = report
        except FileNotFoundError:
            problems.append(f"{role} left no figures ({path.name})")
        except (OSError, ValueError) as error:
            problems.append(f"{path}: {error}")
    return reports, problems


def merge(reports):
    """The figures of a run: {role: report} into one object with the keys that scripts rely on."""
    frontend = reports.get(FRONTEND, {})
    summary = {key: frontend.get(key) for key in FRONTEND_KEYS}
    summary.update({key: reports.get("loop_closer", {}).get(key) for key in LOOP_KEYS})
    for key in PROCESS_KEYS:
        summary[key] = {role: report[key] for role, report in reports.items() if key in report}
    bytes_sent = {}
    for report in reports.values():
        for topic, count in report.get("bytes_sent", {}).items():
            bytes_sent[topic] = bytes_sent.get(topic, 0) + count
    summary["bytes_sent"] = dict(sorted(bytes_sent.items()))
    return summary


def merge_robots(atlas, robots):
    """Several robots' summaries and the atlas_server's into one: {folder: summary} under "robots"; of each process, by FOLDER/ROLE, time, memory
    and how it ended; frames of all robots together."""
    summary = {key: None for key in FRONTEND_KEYS + LOOP_KEYS}
    summary.update({key: sum(robot[key] or 0 for robot in robots.values()) for key in ("frames", "tracked", "dropped")})
    for key in (*PROCESS_KEYS, "exit_codes"):
        summary[key] = {**atlas[key], **{f"{folder}/{role}": value for folder, robot in robots.items() for role, value in robot[key].items()}}
    summary["bytes_sent"] = {}
    for part in (atlas, *robots.values()):
        for topic, count in part["bytes_sent"].items():
            summary["bytes_sent"][topic] = summary["bytes_sent"].get(topic, 0) + count
    summary["robots"] = robots
    return summary


def write_json(path, value):
    """Under another name first, then renamed: never half a file, and nothing left over when the disk is full."""
    partial = path.with_name(path.name + ".partial")
    try:
        with open(partial, "w") as file:
            json.dump(value, file, indent=2)
            file.write("\n")
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise


def describe(summary):
    """The run in two lines, or so many for each robot."""
    if "robots" in summary:
        return "\n".join(f"{folder}: {describe(robot)}" for folder, robot in summary["robots"].items())
    if summary["frames"] is None:
        return "no figures of the frontend"
    text = (f"{summary['tracked']} of {summary['frames']} frames tracked, {summary['dropped']} dropped, {summary['maps']} maps, "
            f"{summary['keyframes']} keyframes, {summary['points']} points")
    if summary["loops"]:
        text += f", {summary['loops']} loops closed"
    frame_ms = summary["frame_ms"] or {}
    if frame_ms.get("median") is not None:  # null when no frame was tracked
        text += f"; a frame takes {frame_ms['median']:.1f} ms (median), {frame_ms['p95']:.1f} ms (p95)"
    cpu_s, memory_mb = sum(summary["cpu_s"].values()), sum(summary["peak_memory_mb"].values())
    return text + f"\n  {cpu_s:.1f} s of CPU, {memory_mb:.0f} MB of memory at most, in {len(summary['cpu_s'])} processes"
