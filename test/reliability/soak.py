#!/usr/bin/env python3
"""Drives laps through a rendered town for as long as it is told, at full speed, and watches what the processes take: memory, descriptors, queues.

  soak.py --out /tmp/soak                          an hour
  soak.py --out /tmp/soak --minutes 10 --size 320x240
  soak.py --out /tmp/soak --plot-only              draws an earlier run's samples again
  soak.py --out /tmp/soak --plot-only --report docs/reliability.md --with-plot    writes their table into its section of the page, the plot beside

A known place adds nothing, so after the first laps all of it should be flat. Leaves in OUT: samples.jsonl (a line a second, as `portolan status --json` has it),
soak.svg, soak.json. Exit code: 0 flat, 1 something grew or the run failed, 2 bad arguments.
"""

import argparse
import json
import math
import pathlib
import shutil
import signal
import statistics
import subprocess
import sys
import time

import report_section

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
EXIT_OK, EXIT_GREW, EXIT_USAGE = 0, 1, 2
ROLES = ("frontend_tracker", "backend_mapper", "loop_closer", "atlas_server")
COLOURS = dict(zip(ROLES, ("#c02020", "#2050c0", "#208040", "#a07000")))
SECTION, PLOT = "soak (test/reliability/soak.py)", "soak.svg"
# Frames a second that no tracker reaches here: so many are listed that the run never comes to their end.
MAX_RATE = 250
FPS = 20
# The first laps make the map; in those after it loops close and forward BA settles.
WARM_LAPS = 3


class Failure(Exception):
    pass


class Panel:
    """A plot, and what growth it bears from the first quarter after the warm-up to the last."""

    def __init__(self, title, figures, scale, share, absolute):
        self.title, self.figures, self.scale, self.share, self.absolute = title, figures, scale, share, absolute

    def value(self, process):
        held = [process["figures"][name] for name in self.figures if name in process["figures"]]
        return sum(held) * self.scale if held else None


# Memory: what an allocator keeps in pieces goes up and down by a few per cent. Descriptors: a timer or a socket may be open for a moment.
# Queues: keyframes come in bursts. The map: pruning and creation balance each other only on average.
PANELS = (
    Panel("memory [MB]", ("resident_bytes",), 1e-6, 0.05, 5.0),
    Panel("descriptors", ("open_files",), 1, 0.0, 2.0),
    Panel("queues", ("events_waiting", "keyframes_waiting", "unacknowledged_keyframes", "pending_requests", "lag"), 1, 0.5, 10.0),
    Panel("keyframes", ("keyframes",), 1, 0.03, 3.0),
)


def read_poses(path):
    """Positions and quaternions of TUM lines."""
    lines = [line.split() for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return [(tuple(map(float, words[1:4])), tuple(map(float, words[4:8]))) for words in lines]


def turn_between(a, b):
    """Radians between two orientations."""
    return 2 * math.acos(min(1.0, abs(sum(x * y for x, y in zip(a, b)))))


def find_lap(poses):
    """How many frames it takes until the camera is where it began and looks the same way: the next lap goes on from there without a jump."""
    step = math.dist(poses[0][0], poses[1][0])
    def gap(i):
        return math.dist(poses[i][0], poses[0][0]) + turn_between(poses[i][1], poses[0][1])
    lap = min(range(len(poses) // 2, len(poses)), key=gap)
    if gap(lap) > 5 * step:
        raise Failure(f"the way does not come back to its start (closest: frame {lap}, {gap(lap):.3f})")
    return lap


def write_laps(data, folder, num_frames):
    """A data set of laps without end: the first lap's pictures listed again and again, with times that rise. @return frames of a lap."""
    lap = find_lap(read_poses(data / "groundtruth.txt"))
    pictures = [line.split()[1] for line in (data / "rgb.txt").read_text().splitlines() if line and not line.startswith("#")][:lap]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "camera.yaml").write_text((data / "camera.yaml").read_text())
    link = folder / "rgb"
    if not link.exists():
        link.symlink_to((data / "rgb").resolve())
    with open(folder / "rgb.txt", "w", encoding="ascii") as file:
        for i in range(num_frames):
            file.write(f"{i / FPS:.6f} {pictures[i % lap]}\n")
    return lap


def render(options):
    data = options.out / f"town_{options.size}"
    if not (data / "groundtruth.txt").exists():
        print(f"soak: rendering the town into {data}", flush=True)
        command = [options.bin / "portolan_synth", "town", "--out", data, "--fps", FPS, "--size", options.size, "--force", "--quiet"]
        subprocess.run([str(word) for word in command], check=True)
    return data


def watch(options, run, samples):
    """Appends what `portolan status` says each second until the time is over or the run ends. @return whether the run lasted."""
    command = [options.bin / "portolan", "--domain", options.domain, "--dds", options.dds, "--timeout", 60, "status", "--json", "--watch"]
    started = time.monotonic()
    with subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, text=True) as status, open(samples, "w", encoding="utf-8") as file:
        try:
            for line in status.stdout:
                elapsed_s = time.monotonic() - started
                file.write(json.dumps({"s": round(elapsed_s, 1), "processes": json.loads(line)}) + "\n")
                file.flush()
                if run.poll() is not None:
                    return False
                if elapsed_s >= options.minutes * 60:
                    return True
        finally:
            status.terminate()
    return False


def drive(options):
    laps = options.out / "laps"
    lap = write_laps(render(options), laps, int(options.minutes * 60 * MAX_RATE))
    command = [options.bin.parent / "share/portolan/launch_scripts/run.sh", "--bin", options.bin, "--data", laps, "--out", options.out / "run", "--speed", "max",
               "--domain", options.domain, "--dds", options.dds]
    with open(options.out / "run.txt", "w", encoding="utf-8") as log:
        with subprocess.Popen([str(word) for word in command], stdout=log, stderr=log) as run:
            try:
                lasted = watch(options, run, options.out / "samples.jsonl")
            finally:
                run.send_signal(signal.SIGINT)
    (options.out / "lap.json").write_text(json.dumps({"frames": lap}))
    if not lasted:
        raise Failure(f"the run ended early; {options.out / 'run.txt'} says why")


def read_series(out):
    """(seconds, frames of the tracker, {(panel index, role): values}), one of each for each sample."""
    samples = [json.loads(line) for line in (out / "samples.jsonl").read_text().splitlines()]
    seconds, frames, series = [], [], {}
    for sample in samples:
        seconds.append(sample["s"])
        by_role = {process["role"]: process for process in sample["processes"]}
        frames.append(by_role.get(ROLES[0], {"figures": {}})["figures"].get("frames"))
        for role in ROLES:
            for i, panel in enumerate(PANELS):
                series.setdefault((i, role), []).append(panel.value(by_role[role]) if role in by_role else None)
    return seconds, frames, series


def first_warm(frames, lap):
    """Index of the first sample after the warm-up, or one at two fifths where it was longer."""
    warm = next((i for i, count in enumerate(frames) if count is not None and count >= WARM_LAPS * lap), len(frames))
    return min(warm, len(frames) * 2 // 5)


def judge(panel, values):
    """{first, last, grew}: medians of the first and last quarter of the warm samples; None where there are too few."""
    held = [value for value in values if value is not None]
    quarter = len(held) // 4
    if quarter < 5:
        return None
    first, last = statistics.median(held[:quarter]), statistics.median(held[-quarter:])
    return {"first": round(first, 2), "last": round(last, 2), "grew": last > first * (1 + panel.share) + panel.absolute}


def nice_ticks(top):
    step = 10 ** math.floor(math.log10(max(top, 1e-9)))
    step = next(s for s in (step / 5, step / 2, step, 2 * step) if top / s <= 5)
    return [i * step for i in range(int(top / step) + 1)]


def draw(seconds, frames, series, lap):
    """The panels below each other over minutes, with a tick at the end of each lap."""
    width, height, left, gap = 900, 190, 70, 45
    end = max(seconds[-1], 1)
    def x(s):
        return left + s / end * (width - left - 20)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{len(PANELS) * (height + gap) + 40}" font-family="sans-serif" font-size="12">',
             '<rect width="100%" height="100%" fill="white"/>']
    for n, role in enumerate(ROLES):
        parts.append(f'<text x="{left + n * 160}" y="18" fill="{COLOURS[role]}">{role}</text>')
    lap_ends = [seconds[i] for i in range(1, len(frames)) if frames[i] and frames[i - 1] and frames[i] // lap > frames[i - 1] // lap]
    for i, panel in enumerate(PANELS):
        bottom = 40 + i * (height + gap) + height
        top = max([value for role in ROLES for value in series[(i, role)] if value is not None], default=1) * 1.1 or 1
        def y(value, bottom=bottom, top=top):
            return bottom - value / top * (height - 20)
        parts.append(f'<text x="{left}" y="{bottom - height + 12}">{panel.title}</text>')
        for tick in nice_ticks(top):
            parts.append(f'<line x1="{left}" x2="{width - 20}" y1="{y(tick):.1f}" y2="{y(tick):.1f}" stroke="#ddd"/>'
                         f'<text x="{left - 6}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>')
        for tick in nice_ticks(end / 60):
            parts.append(f'<text x="{x(tick * 60):.1f}" y="{bottom + 16}" text-anchor="middle">{tick:g}{" min" if tick == 0 else ""}</text>')
        parts.extend(f'<line x1="{x(s):.1f}" x2="{x(s):.1f}" y1="{bottom}" y2="{bottom + 4}" stroke="#888"/>' for s in lap_ends)
        for role in ROLES:
            points = " ".join(f"{x(s):.1f},{y(value):.1f}" for s, value in zip(seconds, series[(i, role)]) if value is not None)
            parts.append(f'<polyline points="{points}" fill="none" stroke="{COLOURS[role]}"/>')
    return "\n".join([*parts, "</svg>\n"])


def report(out, lap):
    """Draws, prints the table, writes soak.json. @return whether all was flat."""
    seconds, frames, series = read_series(out)
    if not seconds or frames[-1] is None:
        raise Failure("no figures of the tracker came")
    warm = first_warm(frames, lap)
    (out / PLOT).write_text(draw(seconds, frames, series, lap))
    verdicts = {}
    laps = frames[-1] / lap
    print(f"{laps:.1f} laps of {lap} frames in {seconds[-1] / 60:.1f} minutes; judged from minute {seconds[warm] / 60:.1f} on")
    for (i, role), values in series.items():
        verdict = judge(PANELS[i], values[warm:])
        if verdict is not None:
            verdicts.setdefault(PANELS[i].title, {})[role] = verdict
            print(f"{PANELS[i].title:12} {role:17} {verdict['first']:9.1f} -> {verdict['last']:9.1f}  {'GREW' if verdict['grew'] else 'flat'}")
    found = {"laps": laps, "lap_frames": lap, "minutes": seconds[-1] / 60, "judged_from_minute": seconds[warm] / 60, "verdicts": verdicts}
    (out / "soak.json").write_text(json.dumps(found, indent=2) + "\n")
    print(f"plot in {out / PLOT}")
    return bool(verdicts) and not any(verdict["grew"] for roles in verdicts.values() for verdict in roles.values())


def table(found):
    """Markdown, of what is in soak.json: a row for each process."""
    lines = [f"{found['laps']:.0f} laps of {found['lap_frames']} frames in {found['minutes']:.0f} minutes. From minute {found['judged_from_minute']:.1f} on: "
             "medians of the first and the last quarter.", "",
             "| process | " + " | ".join(panel.title for panel in PANELS) + " | verdict |", "| --- |" + " --- |" * (len(PANELS) + 1)]
    for role in ROLES:
        judged = {panel.title: found["verdicts"].get(panel.title, {}).get(role) for panel in PANELS}
        cells = ["-" if one is None else f"{one['first']:.1f} to {one['last']:.1f}" for one in judged.values()]
        grew = [title.split()[0] for title, one in judged.items() if one is not None and one["grew"]]
        words = "grew: " + ", ".join(grew) if grew else "flat" if any(judged.values()) else "too few samples"
        lines.append(f"| {role} | " + " | ".join(cells) + f" | {words} |")
    return "\n".join(lines)


def write_report(page, out, with_plot):
    """The table into its section of the page, and the plot beside it if asked for."""
    text = table(json.loads((out / "soak.json").read_text()))
    if with_plot:
        shutil.copyfile(out / PLOT, page.parent / PLOT)
        text += f"\n\n![Memory, descriptors, queues and keyframes over time]({PLOT})"
    report_section.write(page, SECTION, text)


def parse(arguments):
    parser = argparse.ArgumentParser(prog="soak.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--size", default="640x480", help="of the pictures")
    parser.add_argument("--dds", choices=("fastdds", "cyclonedds"), default="fastdds")
    parser.add_argument("--domain", type=int, default=99)
    parser.add_argument("--bin", type=pathlib.Path, default=REPOSITORY / "install/bin")
    parser.add_argument("--plot-only", action="store_true")
    parser.add_argument("--report", type=pathlib.Path, metavar="FILE", help="page whose section the table is written into")
    parser.add_argument("--with-plot", action="store_true", help="with --report: copy the plot beside the page")
    options = parser.parse_args(arguments)
    if not (math.isfinite(options.minutes) and options.minutes > 0):
        parser.error(f"--minutes {options.minutes}: more than 0 expected")
    if options.with_plot and options.report is None:
        parser.error("--with-plot: goes with --report")
    if options.report is not None:
        try:
            report_section.replace(options.report.read_text(), SECTION, "")
        except (OSError, report_section.SectionError) as error:
            parser.error(f"--report {options.report}: {error}")
    return options


def main(arguments):
    options = parse(arguments)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        if not options.plot_only:
            drive(options)
        lap = json.loads((options.out / "lap.json").read_text())["frames"]
        is_flat = report(options.out, lap)
        if options.report is not None:
            write_report(options.report, options.out, options.with_plot)
        return EXIT_OK if is_flat else EXIT_GREW
    except (Failure, OSError, subprocess.CalledProcessError) as error:
        print(f"soak.py: {error}", file=sys.stderr)
        return EXIT_GREW


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
