"""The pure parts of failures.py: who is killed when, what a witness saw, what a run's outcome is worth, the table."""

import collections
import itertools
import random

ROLES = ("atlas_server", "backend_mapper", "loop_closer", "frontend_tracker")
VENDORS = ("fastdds", "cyclonedds")
DELAYS_S = (0, 2, 10)
# A pair dies at one moment in every second run, else so much apart at most.
MAX_APART_S = 2.0
# "an ATE within 20 % of an undisturbed run"
MAX_ATE_RATIO = 1.2

# One run. kills: [(seconds after the first tracked frame, role)], by time; each is started again delay_s after its end.
Case = collections.namedtuple("Case", "number seed vendor kills delay_s")

COLUMNS = ("run", "seed", "vendor", "killed (s)", "restarted after", "tracked", "maps", "ATE (m)", "of undisturbed", "keyframes acknowledged", "of them there",
           "map", "verdict")


def victims():
    """Each process alone, and all pairs."""
    return [(role,) for role in ROLES] + list(itertools.combinations(ROLES, 2))


def make_plan(runs, seed, window, vendors=VENDORS, delays=DELAYS_S):
    """So many cases: every combination of victims, delay and vendor in a random order, over and over. window: (first, last) second to kill at."""
    order = random.Random(seed)
    combinations = []
    while len(combinations) < runs:
        turn = list(itertools.product(victims(), delays, vendors))
        order.shuffle(turn)
        combinations += turn
    return [make_case(number, seed * 1000 + number, vendor, roles, delay_s, window)
            for number, (roles, delay_s, vendor) in enumerate(combinations[:runs], start=1)]


def make_case(number, seed, vendor, roles, delay_s, window):
    """The moments come from the case's own seed, so that it can be made again alone."""
    source = random.Random(seed)
    first = source.uniform(*window)
    apart = source.choice((0.0, source.uniform(0, MAX_APART_S)))
    roles = source.sample(roles, len(roles))
    return Case(number, seed, vendor, [(round(first + index * apart, 3), role) for index, role in enumerate(roles)], delay_s)


def timeline(case):
    """[(seconds, "kill" or "start", role)] in the order of time; a kill comes before a start of the same moment."""
    steps = [(moment, "kill", role) for moment, role in case.kills]
    steps += [(moment + case.delay_s, "start", role) for moment, role in case.kills]
    return sorted(steps, key=lambda step: (step[0], step[1] != "kill"))


def read_witness(lines):
    """What maps were told to hold by their owners, from portolan_run_witness: keyframes that came into one and did not go from it again.

    A whole state that someone fetched may come behind younger deltas: it is what the map was, not what it is.
    """
    held, youngest = {}, {}
    for line in lines:
        kind, *fields = line.split()
        if kind != "delta":
            raise ValueError(f"the witness wrote '{line.strip()}', expected a delta")
        map_id, age = fields[0], (int(fields[1]), int(fields[3]))
        if age < youngest.get(map_id, age):
            continue
        youngest[map_id] = age
        for change in fields[4:]:
            held[change[1:]] = change[0] == "+"
    return {keyframe for keyframe, is_held in held.items() if is_held}


def judge(result, limit):
    """Why a run failed, as a list of reasons; none: it is good. result: see failures.run_case. limit: of the ATE, in metres."""
    reasons = [f"{role} ended with code {code}" for role, code in result["exit_codes"].items() if code != 0]
    reasons += result["problems"]
    if result["missing"]:
        reasons.append(f"{len(result['missing'])} keyframes lost")
    if result["ate"] is None:
        reasons.append("no trajectory")
    elif limit is not None and result["ate"] > limit:
        reasons.append("ATE")
    return reasons


def row(case, result, limit):
    reasons = judge(result, limit)
    killed = ", ".join(f"{role} {moment:.1f}" for moment, role in case.kills)
    ratio = "-" if result["ate"] is None or limit is None else f"{100 * MAX_ATE_RATIO * result['ate'] / limit:.0f} %"
    acknowledged = len(result["acknowledged"])
    cells = (case.number, case.seed, case.vendor, killed, f"{case.delay_s:g} s", f"{result['tracked']} of {result['frames']}", result["maps"],
             "-" if result["ate"] is None else f"{result['ate']:.4f}", ratio, acknowledged, acknowledged - len(result["missing"]),
             "unsound" if result["problems"] else "valid", "; ".join(reasons) or "good")
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def head():
    return "| " + " | ".join(COLUMNS) + " |\n" + "|" + " --- |" * len(COLUMNS)


def same_frames(trajectory, of):
    """The lines of a trajectory (TUM) whose frames another one has too: the ATE of a run that misses a third is that of other places."""
    def stamp(line):
        return line.split()[0]

    stamps = {stamp(line) for line in of if line.strip() and not line.startswith("#")}
    return [line for line in trajectory if line.strip() and not line.startswith("#") and stamp(line) in stamps]


def ate_limit(ates):
    """Metres, from the undisturbed runs' (None: one without a trajectory): of the worst of them, for runs in real time differ. None if there is none."""
    known = [ate for ate in ates if ate is not None]
    return MAX_ATE_RATIO * max(known) if known else None


def summarize(done, references):
    """The section of the page: done: [(case, result, limit)], references: {vendor: [result]}."""
    good = sum(not judge(result, limit) for case, result, limit in done)
    lines = [f"{good} of {len(done)} runs good: valid maps, no acknowledged keyframe lost, an ATE of at most {100 * MAX_ATE_RATIO:.0f} % of the undisturbed runs' "
             "on the same frames.", ""]
    worst = {vendor: ate_limit([result["ate"] for result in results]) for vendor, results in references.items()}
    lines += ["Undisturbed, on all frames, the worst of so many runs: " + "; ".join(
        f"{vendor}: {worst[vendor] / MAX_ATE_RATIO:.4f} m of {len(results)}" for vendor, results in references.items() if worst[vendor]) + ".", "", head()]
    lines += [row(case, result, limit) for case, result, limit in done]
    return "\n".join(lines)
