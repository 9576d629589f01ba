#!/usr/bin/env python3
"""Runs Portolan on two machines that are network namespaces: the tracker on one, the rest on the other, over a link that is good, lossy, slow or cut.

Needs root (namespaces, TAP devices). Prints a row of the table for each case as it ends; --document writes them into their section of docs/reliability.md
(report_section.py), where the rows of other cases stay. Every run's results stay in the output folder.

  sudo test/reliability/network.py                                     all cases, on a rendered place seen again and again
  sudo test/reliability/network.py --list
  sudo test/reliability/network.py --cases cut_20s slow --data ../shared/data/kitchen
  sudo test/reliability/network.py --document docs/reliability.md --cases slow_fast_fast

Exit code: 0 all cases as they should be, 1 one was not, 2 bad arguments, or no root.
"""

import argparse
import dataclasses
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import threading
import time

import network_link
import report_section
from network_link import ADDRESSES, RACK, ROBOT, Quality

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "test" / "benchmark"))
import report_table  # noqa: E402  (its folder is known only now)

EXIT_FAILED, EXIT_USAGE = 1, 2
FIRST_DOMAIN = 100
SECTION = "two machines (test/reliability/network.py)"
# "The tracker's rate is unharmed": frames dropped, or as many as undisturbed.
MAX_DROPPED = 0.01
# "The sender's memory stays bounded": the tracker keeps so many keyframes without answer, and its writer so many on their way (docs/machines.md); besides, the
# map goes on growing, and an allocator keeps pieces.
KEPT_KEYFRAMES, KEYFRAME_BYTES = 512 + 256, 83e3  # at 2000 features; used where the run tells no bytes
OTHER_GROWTH_MB = 20
INTRODUCTION = """## Two machines
By `test/reliability/network.py`: the tracker on one machine, mapper, loop_closer and atlas_server on the other, two network namespaces with a relay between
them; vendors are the tracker's and the others'. A rendered street, driven up and down in real time, 1000 features; cuts and standstills begin 20 s after the
first frame. Up and down: all bytes on the link, mean and most over 5 s; to be aimed at are 400 kB/s up at 5 key frames a second and 250 down. Memory is the
tracker's at most, and how far it grew after those 20 s: at most what 768 key frames take (512 that it keeps, 256 of its writer), and 20 MB. "All": the
tracker's map and both replicas on the far side have the same hash at the end, no key frame is without answer or was given up, and of the frames at most 1 %
were dropped, or as many as undisturbed.
"""
COLUMNS = ("case", "tracked", "dropped", "frame ms (p95)", "ATE (m)", "maps", "keyframes/s", "kB a keyframe", "up kB/s (most)", "down kB/s (most)",
           "sent again", "given up", "tracker MB (grew)", "far side has")

SLOW_BYTES_PER_S = 1e6  # 8 Mbit/s
SAMPLE_S = 0.5
RATE_WINDOW = 10        # samples: rates are of five seconds
END_WAIT_S = 60.0
PROGRESS = re.compile(rb"frame (\d+)  (\w+)")


@dataclasses.dataclass(frozen=True)
class Case:
    """One run. `dds`: vendor of the robot, of the rack. `settings`: --set of both."""

    name: str
    text: str
    dds: tuple = ("fastdds", "fastdds")
    quality: Quality = Quality()
    cut_at_s: float = 20.0      # from the first frame on; by then the place is known
    cut_s: float = 0.0
    peers: bool = False
    stopped: str = ""           # role that stands still (SIGSTOP) for cut_s instead of the link
    settings: tuple = ()

    def is_undisturbed(self):
        return self.quality == Quality() and self.cut_s == 0


MIXED = {"fast": "fastdds", "cyclone": "cyclonedds"}
CASES = (
    *(Case(f"{'peers' if peers else 'multicast'}_{a}_{b}", f"{a} to {b}, {'static peers' if peers else 'multicast'}", (MIXED[a], MIXED[b]), peers=peers)
      for peers in (False, True) for a, b in (("fast", "cyclone"), ("cyclone", "fast"))),
    *(Case(f"cut_{seconds}s_{a}_{b}", f"link cut for {seconds} s, {a} to {b}", (MIXED[a], MIXED[b]), cut_s=seconds)
      for seconds in (5, 20, 60) for a, b in (("fast", "cyclone"), ("cyclone", "fast"))),
    *(Case(f"lossy_{a}_{b}", f"2 % loss, 10 ms delay, {a} to {b}", (MIXED[a], MIXED[b]), Quality(delay_s=0.01, loss=0.02),
           settings=("dds.small_datagrams=true",))
      for a, b in (("fast", "cyclone"), ("cyclone", "fast"))),
    *(Case(f"slow_{a}_{b}", f"8 Mbit/s, {a} to {b}", (MIXED[a], MIXED[b]), Quality(bytes_per_s=SLOW_BYTES_PER_S), peers=True)
      for a, b in (("fast", "fast"), ("cyclone", "cyclone"))),
    *(Case(f"stopped_{role}_{a}", f"{role} stands still for 70 s, {a}", (MIXED[a], MIXED[a]), stopped=role, cut_s=70)
      for role, a in (("loop_closer", "fast"), ("loop_closer", "cyclone"), ("backend_mapper", "fast"))),
)


def say(message):
    print(f"network.py: {message}", file=sys.stderr, flush=True)


class Machine:
    """run.sh on one of the two."""

    def __init__(self, link, host, case, options, arguments):
        self.out = options.out / case.name / host
        self.out.mkdir(parents=True, exist_ok=True)
        command = [REPOSITORY / "launch_scripts" / "run.sh", "--bin", options.bin, "--out", self.out, "--domain", options.domain,
                   "--dds", case.dds[0 if host == ROBOT else 1], *arguments]
        if case.peers:
            command += ["--peers", ADDRESSES[RACK if host == ROBOT else ROBOT]]
        for setting in (*options.set, *case.settings):
            command += ["--set", setting]
        self.progress = (0, "")  # frame, state
        with open(self.out / "run.log", "wb") as errors:
            self.child = subprocess.Popen(link.command(host, [str(part) for part in command]), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                          stderr=errors, start_new_session=True)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        with open(self.out / "progress.txt", "wb") as progress:
            for line in self.child.stdout:
                progress.write(line)
                found = PROGRESS.match(line)
                if found:
                    self.progress = (int(found[1]), found[2].decode())

    def pids(self):
        """{role: process number} of what it started."""
        return {role: pid for role in ROLES if (pid := find_process(self.out, role)) is not None}

    def wait(self, seconds):
        try:
            return self.child.wait(seconds)
        except subprocess.TimeoutExpired:
            return None

    def end(self):
        """Ends it in order, else for good. Returns its exit code."""
        if self.child.poll() is None:
            self.child.send_signal(signal.SIGINT)
        code = self.wait(END_WAIT_S)
        if code is None:
            os.killpg(self.child.pid, signal.SIGKILL)  # run.sh's children end with it
            code = self.child.wait()
        self._reader.join(5)
        self.child.stdout.close()
        return code

    def report(self, name):
        try:
            return json.loads((self.out / f"{name}.json").read_text())
        except (OSError, ValueError):
            return {}


ROLES = ("frontend_tracker", "backend_mapper", "loop_closer", "atlas_server")


def find_process(out, role):
    """The process of the role that writes into `out`, among all of this machine."""
    program = f"portolan_{role}"
    for folder in pathlib.Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if pathlib.Path(words[0].decode(errors="replace")).name == program and str(out).encode() in words:
            return int(folder.name)
    return None


def resident_mb(pid):
    """Memory of a process, or None if it is gone."""
    try:
        for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) * 1024e-6
    except OSError:
        pass
    return None


class Watch:
    """Samples of a run: bytes over the link, memory, the tracker's state."""

    def __init__(self, link, robot, rack):
        self.link, self.robot, self.rack = link, robot, rack
        self.samples = []
        self.pids = {}

    def take(self, phase):
        if len(self.pids) < len(ROLES):
            self.pids = {**self.rack.pids(), **self.robot.pids()}
        memory = {role: resident_mb(pid) for role, pid in self.pids.items()}
        self.samples.append((time.monotonic(), phase, self.link.bytes_sent(ROBOT), self.link.bytes_sent(RACK), memory, self.robot.progress))

    def rates(self, column):
        """Bytes a second over windows of some seconds."""
        pairs = zip(self.samples, self.samples[RATE_WINDOW:])
        return [(late[column] - early[column]) / (late[0] - early[0]) for early, late in pairs if early[5][0] > 0]

    def memory(self, role, phases=None):
        return [sample[4][role] for sample in self.samples if sample[4].get(role) and (phases is None or sample[1] in phases)]

    def seconds(self):
        """From the first frame to the last sample."""
        moments = [sample[0] for sample in self.samples if sample[5][0] > 0]
        return moments[-1] - moments[0] if moments else 0

    def share_tracked(self, phase):
        states = [sample[5][1] for sample in self.samples if sample[1] == phase]
        return sum(state == "tracking" for state in states) / len(states) if states else None


def play(link, case, options):
    """Runs the case. Returns its figures."""
    link.quality = case.quality
    rack = Machine(link, RACK, case, options, ["--roles", "atlas,mapper,loop"])
    robot = Machine(link, ROBOT, case, options, ["--roles", "frontend", "--data", options.data, "--speed", options.speed])
    watch = Watch(link, robot, rack)
    try:
        follow(link, case, watch, robot, options)
        code = robot.end()
    finally:
        link.restore()
        robot.end()
        rack_code = rack.end()
        link.quality = Quality()
    return figures(case, options, watch, robot, rack, (code, rack_code))


def follow(link, case, watch, robot, options):
    """Until the robot's run is over: cuts and restores at their times from the first frame on."""
    started, phase = None, "before"
    deadline = time.monotonic() + options.timeout
    while robot.child.poll() is None and time.monotonic() < deadline:
        time.sleep(SAMPLE_S)
        watch.take(phase)
        if started is None and robot.progress[0] > 0:
            started = time.monotonic()
        if started is None:
            continue
        elapsed = time.monotonic() - started
        if phase == "before" and elapsed >= case.cut_at_s:
            phase = "during"
            if case.cut_s == 0:
                continue
            disturb(link, case, watch, True)
        elif phase == "during" and case.cut_s > 0 and elapsed >= case.cut_at_s + case.cut_s:
            phase = "after"
            disturb(link, case, watch, False)
        if options.verbose:
            say(f"{case.name}: {phase}, frame {robot.progress[0]} {robot.progress[1]}")


def disturb(link, case, watch, begins):
    if case.stopped:
        os.kill(watch.pids[case.stopped], signal.SIGSTOP if begins else signal.SIGCONT)
    elif begins:
        link.cut()
    else:
        link.restore()


def figures(case, options, watch, robot, rack, codes):
    """What came of the run, and in `problems` what should not have."""
    summary, tracker = robot.report("summary"), robot.report("frontend_tracker")
    mapper, atlas, loop = (rack.report(role) for role in ("backend_mapper", "atlas_server", "loop_closer"))
    memory = watch.memory("frontend_tracker")
    before, sent, seconds = watch.memory("frontend_tracker", ("before",)), tracker.get("keyframes_sent"), watch.seconds()
    result = {
        "case": case.name, "text": case.text, "codes": codes,
        "frames": summary.get("frames"), "tracked": summary.get("tracked"), "dropped": summary.get("dropped"),
        "frame_p95_ms": (summary.get("frame_ms") or {}).get("p95"), "maps": summary.get("maps"),
        "ate": evaluate(options, robot.out), "keyframe_bytes": summary.get("bytes_per_keyframe"),
        "up": watch.rates(2), "down": watch.rates(3), "sent_again": tracker.get("keyframes_sent_again"),
        "memory_mb": max(memory, default=None), "memory_grew_mb": max(memory) - before[-1] if memory and before else None,
        "tracked_during": watch.share_tracked("during"), "given_up": tracker.get("keyframes_given_up"),
        "unacknowledged": tracker.get("keyframes_unacknowledged"), "keyframes_sent": sent,
        "keyframes_per_s": sent / seconds if sent is not None and seconds > 0 else None,
        "keyframes_taken": mapper.get("keyframes_taken"), "keyframes_repeated": mapper.get("keyframes_repeated"),
        "rack_memory_mb": {role: max(watch.memory(role), default=None) for role in ROLES[1:]},
        "hashes": {"tracker": tracker.get("map_hash", {}), "atlas_server": atlas.get("map_hash", {}), "loop_closer": loop.get("map_hash", {})},
        "bytes_sent": {"robot": tracker.get("bytes_sent", {}), "mapper": mapper.get("bytes_sent", {}), "atlas": atlas.get("bytes_sent", {})},
    }
    result["problems"] = find_problems(case, result, undisturbed_drops(options.out))
    (options.out / case.name / "figures.json").write_text(json.dumps(result, indent=2) + "\n")
    return result


def same_maps(hashes):
    """Of the tracker's maps, how many the far side's replicas hold bit by bit."""
    tracker = hashes["tracker"]
    same = [map_id for map_id, value in tracker.items() if all(hashes[role].get(map_id) == value for role in ("atlas_server", "loop_closer"))]
    return len(same), len(tracker)


def undisturbed_drops(out):
    """The largest share of frames dropped in the undisturbed runs whose results are in OUT; 0 without any."""
    shares = [0.0]
    for case in CASES:
        path = out / case.name / "figures.json"
        if case.is_undisturbed() and path.is_file():
            result = json.loads(path.read_text())
            shares.append(result["dropped"] / result["frames"] if result["frames"] and result["dropped"] else 0.0)
    return max(shares)


def memory_limit_mb(result):
    """How far the tracker's may grow."""
    return KEPT_KEYFRAMES * (result["keyframe_bytes"] or KEYFRAME_BYTES) * 1e-6 + OTHER_GROWTH_MB


def find_problems(case, result, undisturbed=0.0):
    """What is not as it should be, in words. undisturbed: share of frames dropped without any disturbance."""
    problems = [f"exit code {code} of the {host}" for host, code in zip((ROBOT, RACK), result["codes"]) if code != 0]
    if result["frames"] is None:
        return [*problems, "no figures"]
    if result["unacknowledged"]:
        problems.append(f"{result['unacknowledged']} keyframes without answer")
    same, of = same_maps(result["hashes"])
    if same < of or of == 0:
        problems.append(f"{same} of {of} maps are the same on both sides")
    if result["given_up"]:
        problems.append(f"{result['given_up']} keyframes given up")
    dropped = (result["dropped"] or 0) / result["frames"] if result["frames"] else 0.0
    if dropped > max(MAX_DROPPED, undisturbed):
        problems.append(f"{100 * dropped:.1f} % of the frames dropped")
    if result["memory_grew_mb"] is not None and result["memory_grew_mb"] > memory_limit_mb(result):
        problems.append(f"the tracker's memory grew by {result['memory_grew_mb']:.0f} MB, {memory_limit_mb(result):.0f} expected at most")
    if case.cut_s and not case.stopped and (result["tracked_during"] or 0) < 0.9:
        problems.append(f"tracking in {100 * (result['tracked_during'] or 0):.0f} % of the cut")
    return problems


def evaluate(options, out):
    """Absolute trajectory error in metres, or None."""
    truth = options.data / "groundtruth.txt"
    if not truth.is_file():
        return None
    target = out / "evaluation.json"
    subprocess.run([options.bin / "portolan_eval", truth, out / "trajectory.txt", "--json", target], check=False, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL)
    try:
        return json.loads(target.read_text())["joined"]["ate"]["rmse"]
    except (OSError, ValueError, KeyError):
        return None


def show(value, form="{:.0f}", factor=1.0):
    return "-" if value is None else form.format(factor * value)


def row(result):
    """Cells of the table."""
    if result["frames"] is None:
        return [result["text"], f"failed: {'; '.join(result['problems'])}", *[""] * (len(COLUMNS) - 2)]

    def rate(values):
        return f"{1e-3 * sum(values) / len(values):.0f} ({1e-3 * max(values):.0f})" if values else "-"

    same, of = same_maps(result["hashes"])
    far = "all" if not result["problems"] else "; ".join(result["problems"])
    if not result["problems"] and of > 1:
        far = f"all, {same} maps"
    return [result["text"], f"{show(result['tracked'])} of {show(result['frames'])}", show(result["dropped"]), show(result["frame_p95_ms"], "{:.1f}"),
            show(result["ate"], "{:.3f}"), show(result["maps"]), show(result["keyframes_per_s"], "{:.1f}"), show(result["keyframe_bytes"], "{:.1f}", 1e-3),
            rate(result["up"]), rate(result["down"]), show(result["sent_again"]), show(result["given_up"]),
            f"{show(result['memory_mb'])} ({show(result['memory_grew_mb'])})", far]


def document(path, rows):
    """Writes the rows into their section of the page; those of other cases stay there."""
    texts = [case.text for case in CASES]
    old = report_table.section_of(path.read_text(), SECTION)
    table = [cells for cells in report_table.merge(old, COLUMNS, rows, texts) if cells[0] in texts]
    report_section.write(path, SECTION, "\n".join([INTRODUCTION, report_table.head(COLUMNS), *map(report_table.line, table)]))


def prepare_data(options):
    """A rendered street, driven up and down: after the first pass every place is known."""
    if options.data is not None:
        return options.data
    once, laps = options.out / "data" / "once", options.out / "data" / "laps"
    if not (laps / "rgb.txt").is_file():
        say("rendering a street")
        subprocess.run([options.bin / "portolan_synth", "street", "--out", once, "--frames", "150", "--size", "480x360", "--quiet", "--force"], check=True)
        parts = ",".join(["all", "last-0"] * 13)
        subprocess.run([sys.executable, REPOSITORY / "test" / "sequences" / "make_sequence.py", once, laps, "--parts", parts, "--force"], check=True,
                       stdout=subprocess.DEVNULL)
    return laps


def parse(arguments):
    parser = argparse.ArgumentParser(prog="network.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    add = parser.add_argument
    add("--cases", nargs="+", metavar="CASE", help="some of --list (default: all)")
    add("--list", action="store_true", help="names the cases")
    add("--data", type=pathlib.Path, help="sequence of 100 s or more in known places (default: one is rendered)")
    add("--speed", default="1", help="see run.sh")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="configuration of all processes (default: orb.num_features=1000)")
    add("--domain", type=int, default=FIRST_DOMAIN, help="default: %(default)s")
    add("--out", type=pathlib.Path, default=pathlib.Path("/tmp/portolan_network"), help="default: %(default)s")
    add("--bin", type=pathlib.Path, default=REPOSITORY / "install" / "bin", help="default: %(default)s")
    add("--timeout", type=float, default=400, metavar="S", help="for a run (default: %(default)s)")
    add("--document", type=pathlib.Path, metavar="FILE", help="page whose section the rows are written into")
    add("--verbose", action="store_true")
    options = parser.parse_args(arguments)
    known = {case.name: case for case in CASES}
    for name in options.cases or ():
        if name not in known:
            parser.error(f"--cases: '{name}', expected some of {', '.join(known)}")
    options.cases = [known[name] for name in options.cases] if options.cases else list(CASES)
    options.set = options.set or ["orb.num_features=1000"]
    if options.data is not None and not options.data.is_dir():
        parser.error(f"--data {options.data}: no such folder")
    if options.document is not None:
        try:
            report_section.replace(options.document.read_text(), SECTION, "")
        except (OSError, report_section.SectionError) as error:
            parser.error(f"--document {options.document}: {error}")
    return options


def main(arguments):
    options = parse(arguments)
    if options.list:
        print("\n".join(f"{case.name:28}{case.text}" for case in options.cases))
        return 0
    if (reason := network_link.why_impossible()) is not None:
        say(reason)
        return EXIT_USAGE
    options.out.mkdir(parents=True, exist_ok=True)
    options.out, options.bin = options.out.resolve(), options.bin.resolve()
    options.data = prepare_data(options).resolve()
    results = []
    print(report_table.head(COLUMNS), flush=True)
    for case in options.cases:
        say(f"{case.name}: {case.text}")
        with network_link.Link() as link:
            results.append(play(link, case, options))
        print(report_table.line(row(results[-1])), flush=True)
        if options.document:
            document(options.document, [row(results[-1])])
    failed = [result["case"] for result in results if result["problems"]]
    if failed:
        say(f"not as it should be: {', '.join(failed)}")
    return EXIT_FAILED if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
