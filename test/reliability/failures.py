#!/usr/bin/env python3
"""Kills processes of real runs at random moments, starts them again, and looks whether anything was lost.

Each run starts the four processes on a short sequence, kills one or two of them with SIGKILL at random moments, starts them again after 0, 2 or 10 s
(the frontend with --resume), and afterwards compares with undisturbed runs: the ATE, the maps in atlas.db (every invariant of a map), and that each
keyframe which an owner's delta had acknowledged is still there. What is drawn comes from the seed: a run can be made again alone.

  test/reliability/failures.py                                     60 runs: every victim or pair, delay and vendor once (three quarters of an hour)
  test/reliability/failures.py --only 17                           that one of them again
  test/reliability/failures.py --runs 120 --seed 2 --data ../shared/data/kitchen --max-frames 400 --speed 0.5
  test/reliability/failures.py --report                            and writes the table into docs/reliability.md

Results are in OUT/run_NUMBER; runs that are there already are not made again (--again makes them). Exit code: 0 all runs good, 1 not all, 2 usage.
"""

import argparse
import json
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import failures_plan
import report_section

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "launch_scripts"))
import launch_arguments  # noqa: E402

SECTION = "kill -9 (test/reliability/failures.py)"
FRONTEND = launch_arguments.FRONTEND
GROUND_TRUTHS = ("groundtruth.txt", "poses.txt", "mav0/state_groundtruth_estimate0/data.csv")
# What is filmed unless --data is given: twice up and down a street. Without a mapper no map grows, so a camera that goes on into the unknown
# is lost whatever the system does: it has to come by again where it was.
PARTS = "all,last-0,all,last-0"
MADE = pathlib.Path(tempfile.gettempdir()) / "portolan_sequences"  # out of the repository, which holds no data
SCENE = ("street", "--frames", "150", "--size", "320x240", "--seed", "1")
FIRST_KILL_S = 1.5      # after the first tracked frame: from then on there is something to lose
AFTER_RESTART_S = 6.0   # at least left of the run when the last process comes again
START_DEADLINE_S = 60.0
END_DEADLINE_S = 120.0  # after the sequence's end
EXIT_BAD, EXIT_USAGE = 1, 2


def say(text):
    print(text, file=sys.stderr, flush=True)


class RunError(Exception):
    """A run that can't be judged: something did not start or end."""


class Deployment:
    """The four processes of one run and its witness."""

    def __init__(self, options, vendor, out):
        self.options = options
        self.vendor = vendor
        self.out = out
        self.children = {}
        self.codes = {}
        (out / "logs").mkdir(parents=True)

    def command(self, role):
        shared = ["--domain", self.options.domain, "--dds", self.vendor]
        if role == "run_witness":
            return [self.options.bin / "portolan_run_witness", *shared, "--out", self.out / "witness.txt"]
        command = [self.options.bin / f"portolan_{role}", *shared, "--out", self.out, "--log-level", self.options.log_level]
        if role == FRONTEND:
            command += ["--data", self.options.data, "--speed", self.options.speed, "--resume"]
            if self.options.max_frames:
                command += ["--set", f"source.max_frames={self.options.max_frames}"]
        for assignment in self.options.set:
            command += ["--set", assignment]
        return command

    def start(self, role):
        with open(self.out / "logs" / f"{role}.out", "ab") as output:
            self.children[role] = subprocess.Popen(["setpriv", "--pdeathsig", "KILL", *(str(part) for part in self.command(role))],
                                                   stdin=subprocess.DEVNULL, stdout=output, stderr=output)

    def kill(self, role):
        child = self.children[role]
        if child.poll() is not None:
            raise RunError(f"{role} had ended with code {child.returncode} before it was to be killed")
        child.kill()
        child.wait()

    def running(self, role):
        return self.children[role].poll() is None

    def wait(self, role, deadline_s):
        try:
            self.codes[role] = launch_code(self.children[role].wait(deadline_s))
        except subprocess.TimeoutExpired as error:
            raise RunError(f"{role} did not end within {deadline_s:.0f} s") from error

    def interrupt(self, roles):
        for role in roles:
            self.children[role].send_signal(signal.SIGINT)
        for role in roles:
            self.wait(role, END_DEADLINE_S)

    def kill_all(self):
        for child in self.children.values():
            if child.poll() is None:
                child.kill()
            child.wait()


def launch_code(code):
    """As a shell has it."""
    return 128 - code if code < 0 else code


def has_tracked(out):
    try:
        return any(line.startswith("frame ") for line in (out / "frames_journal.txt").read_text().splitlines())
    except FileNotFoundError:
        return False


def wait_for_first_frame(deployment):
    end = time.monotonic() + START_DEADLINE_S
    while not has_tracked(deployment.out):
        if time.monotonic() > end:
            raise RunError(f"no frame was tracked within {START_DEADLINE_S:.0f} s")
        if not deployment.running(FRONTEND):
            raise RunError("the frontend ended before a frame was tracked")
        time.sleep(0.05)


def play(deployment, steps, duration_s):
    """Starts all, takes the steps at their time after the first tracked frame, and waits for the end."""
    for role in ("run_witness", *failures_plan.ROLES):
        deployment.start(role)
    wait_for_first_frame(deployment)
    start = time.monotonic()
    for moment, what, role in steps:
        time.sleep(max(0.0, start + moment - time.monotonic()))
        deployment.kill(role) if what == "kill" else deployment.start(role)
    deployment.wait(FRONTEND, duration_s + END_DEADLINE_S)
    deployment.interrupt([role for role in failures_plan.ROLES if role != FRONTEND])
    deployment.interrupt(["run_witness"])


def run_case(options, vendor, steps, out):
    """One run's result: exit codes, problems of its maps, acknowledged keyframes and those of them that are missing, ATE, figures."""
    if out.exists():
        shutil.rmtree(out)
    deployment = Deployment(options, vendor, out)
    result = {"exit_codes": {}, "problems": [], "acknowledged": [], "missing": [], "ate": None, "tracked": 0, "frames": 0, "maps": 0}
    try:
        play(deployment, steps, options.duration_s)
    except RunError as error:
        result["problems"].append(str(error))
    finally:
        deployment.kill_all()
        result["exit_codes"] = deployment.codes
    examine_maps(options, out, result)
    examine_trajectory(options, out, result)
    (out / "result.json").write_text(json.dumps(result, indent=1))
    return result


def examine_maps(options, out, result):
    check = subprocess.run([options.bin / "portolan_atlas_check", out / "atlas.db"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
    if not check.stdout:
        result["problems"].append(check.stderr.strip())
        return
    atlas = json.loads(check.stdout)
    result["problems"] += atlas["problems"]
    there = {keyframe for one_map in atlas["maps"] for keyframe in one_map["keyframes"]}
    acknowledged = failures_plan.read_witness((out / "witness.txt").read_text().splitlines())
    result["acknowledged"] = sorted(acknowledged)
    result["missing"] = sorted(acknowledged - there)
    result["maps"] = len(atlas["maps"])


def evaluate(options, out, trajectory):
    """What portolan_eval says of a trajectory in a run's folder; None if nothing."""
    if not (out / trajectory).is_file():
        return None
    command = [options.bin / "portolan_eval", options.truth, out / trajectory, "--json", out / "evaluation.json"]
    if options.max_frames:
        command += ["--first-frame", "0", "--last-frame", str(options.max_frames - 1)]
    with open(out / "logs" / "evaluation.out", "wb") as output:
        if subprocess.run(command, stdout=output, stderr=output, check=False).returncode != 0:
            return None
    return json.loads((out / "evaluation.json").read_text())


def ate_of(evaluation):
    return None if evaluation is None else evaluation["joined"].get("ate", {}).get("rmse")


def examine_trajectory(options, out, result):
    evaluation = evaluate(options, out, "trajectory.txt")
    if evaluation is not None:
        result["ate"], result["tracked"], result["frames"] = ate_of(evaluation), evaluation["tracked"], evaluation["frames"]


def limit_of(options, out, references):
    """Of a run's ATE: from undisturbed runs (their folders), on the frames that it tracked."""
    if not (out / "trajectory.txt").is_file():
        return None
    own = (out / "trajectory.txt").read_text().splitlines(keepends=True)
    ates = []
    for reference in references:
        whole = (reference / "trajectory.txt").read_text().splitlines(keepends=True)
        (out / "undisturbed.txt").write_text("".join(failures_plan.same_frames(whole, own)))
        ates.append(ate_of(evaluate(options, out, "undisturbed.txt")))
    return failures_plan.ate_limit(ates)


def recall_or_run(options, vendor, steps, name):
    out = options.out / name
    known = out / "result.json"
    if known.is_file() and not options.again:
        return json.loads(known.read_text())
    return run_case(options, vendor, steps, out)


def render(options):
    """The default sequence, once."""
    there, back = MADE / "street", MADE / "street_and_back"
    if not (back / "groundtruth.txt").is_file():
        say("rendering a street, once")
        subprocess.run([options.bin / "portolan_synth", *SCENE, "--out", there, "--quiet", "--force"], check=True)
        shutil.rmtree(back, ignore_errors=True)
        subprocess.run([REPOSITORY / "test" / "sequences" / "make_sequence.py", there, back, "--parts", PARTS], check=True)
    return back


def frame_times(data):
    """Seconds, of a sequence in TUM or KITTI layout."""
    path = data / "rgb.txt" if (data / "rgb.txt").is_file() else data / "times.txt"
    return [float(line.split()[0]) for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    add = parser.add_argument
    add("--runs", type=int, default=60, help="disturbed runs (default: %(default)s)")
    add("--seed", type=int, default=1, help="of victims, moments and order (default: %(default)s)")
    add("--only", type=int, metavar="N", help="the N-th of these runs alone")
    add("--references", type=int, default=3, help="undisturbed runs with each vendor, to compare with (default: %(default)s)")
    add("--vendors", nargs="+", choices=failures_plan.VENDORS, default=list(failures_plan.VENDORS), metavar="V", help="default: both")
    add("--data", type=pathlib.Path, help="sequence with ground truth, TUM or KITTI layout (default: a rendered street, up and down twice)")
    add("--max-frames", type=int, default=0, help="so many of its frames (default: all)")
    add("--speed", default="1", help="factor of real time (default: %(default)s)")
    add("--out", type=pathlib.Path, default=REPOSITORY / "runs" / "failures", help="default: %(default)s")
    add("--bin", type=pathlib.Path, default=REPOSITORY / "install" / "bin", help="default: %(default)s")
    add("--domain", type=int, help="DDS domain (default: a free one)")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="configuration of all processes; may be given again")
    add("--log-level", choices=launch_arguments.LOG_LEVELS, default="debug", help="default: %(default)s")
    add("--again", action="store_true", help="make runs again whose results are in OUT")
    add("--report", action="store_true", help="write the table into docs/reliability.md")
    options = parser.parse_args(arguments)
    for name in ("portolan_run_witness", "portolan_atlas_check", *(f"portolan_{role}" for role in failures_plan.ROLES)):
        if not (options.bin / name).is_file():
            parser.error(f"{options.bin / name}: no such program; run launch_scripts/build.sh first")
    if options.runs < 1 or options.references < 1:
        parser.error("--runs and --references: expected 1 or more")
    if options.only is not None and not 1 <= options.only <= options.runs:
        parser.error(f"--only {options.only}: expected 1 to {options.runs}")
    options.domain = launch_arguments.derive_domain(0) if options.domain is None else options.domain
    options.out.mkdir(parents=True, exist_ok=True)
    choose_data(options, parser)
    return options


def choose_data(options, parser):
    options.data = options.data or render(options)
    options.truth = next((options.data / name for name in GROUND_TRUTHS if (options.data / name).is_file()), None)
    if options.truth is None:
        parser.error(f"{options.data} has no ground truth ({', '.join(GROUND_TRUTHS)})")
    times = frame_times(options.data)[:options.max_frames or None]
    try:
        options.duration_s = (times[-1] - times[0]) / float(options.speed)
    except (ValueError, ZeroDivisionError):
        parser.error(f"--speed {options.speed}: expected a factor of real time above 0")
    last = options.duration_s - max(failures_plan.DELAYS_S) - failures_plan.MAX_APART_S - AFTER_RESTART_S
    if last < FIRST_KILL_S:
        parser.error(f"{options.data} lasts {options.duration_s:.1f} s, expected at least {options.duration_s - last + FIRST_KILL_S:.1f} s: give a lower --speed")
    options.window = (FIRST_KILL_S, last)


def main(arguments):
    options = parse(arguments)
    cases = failures_plan.make_plan(options.runs, options.seed, options.window, options.vendors)
    if options.only is not None:
        cases = [cases[options.only - 1]]
    say(f"{len(cases)} runs of {options.duration_s:.0f} s on {options.data}, domain {options.domain}, seed {options.seed}; results in {options.out}")
    references, folders = {}, {}
    for vendor in options.vendors:
        names = [f"undisturbed_{vendor}_{number}" for number in range(1, options.references + 1)]
        folders[vendor] = [options.out / name for name in names]
        references[vendor] = [recall_or_run(options, vendor, [], name) for name in names]
        say(f"undisturbed, {vendor}: " + ", ".join(
            f"ATE {result['ate']}, {result['tracked']} of {result['frames']}" + "".join(f"; {reason}" for reason in failures_plan.judge(result, None))
            for result in references[vendor]))
    if any(result["ate"] is None for results in references.values() for result in results):
        say("an undisturbed run has no trajectory to compare with")
        return EXIT_BAD
    print(failures_plan.head(), flush=True)
    done = []
    for case in cases:
        name = f"run_{case.number:03}"
        result = recall_or_run(options, case.vendor, failures_plan.timeline(case), name)
        limit = limit_of(options, options.out / name, folders[case.vendor])
        done.append((case, result, limit))
        print(failures_plan.row(case, result, limit), flush=True)
    good = sum(not failures_plan.judge(result, limit) for case, result, limit in done)
    say(f"{good} of {len(done)} runs good")
    if options.report:
        report_section.write(REPOSITORY / "docs" / "reliability.md", SECTION, failures_plan.summarize(done, references))
    return 0 if good == len(done) else EXIT_BAD


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
