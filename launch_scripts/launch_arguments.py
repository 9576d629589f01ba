"""The command line of run.sh: options, their checks before anything starts, and each process's own command line."""

import argparse
import collections
import math
import os
import pathlib
import socket
import sys

# A process that the launcher starts. `role`: its name in files and in summary.json; `option`: in the launcher's own options.
Role = collections.namedtuple("Role", "option role program")

# In the order of their start: who is asked starts before who asks.
ROLES = (
    Role("atlas", "atlas_server", "portolan_atlas_server"),
    Role("mapper", "backend_mapper", "portolan_backend_mapper"),
    Role("loop", "loop_closer", "portolan_loop_closer"),
    Role("frontend", "frontend_tracker", "portolan_frontend_tracker"),
)
FRONTEND = "frontend_tracker"
ATLAS = "atlas_server"
VENDORS = ("fastdds", "cyclonedds")
LOG_LEVELS = ("trace", "debug", "info", "warn", "error", "off")
EXIT_USAGE = 2

# UDP ports of a domain start at 7400 + 250 x domain (DDSI-RTPS 9.6.1.1): those of the first 101 domains lie below Linux's ephemeral ports (32768).
FIRST_PORT, PORTS_PER_DOMAIN, MAX_DERIVED_DOMAIN = 7400, 250, 101
# Highest domain both vendors take.
MAX_DOMAIN = 230
MAX_ROBOT = 65535
# On one machine, and in one atlas's tests so far.
MAX_ROBOTS = 16
# DDS partition of robots that share an atlas_server.
FLEET = "fleet"

HERE = pathlib.Path(__file__).resolve().parent
# In an installed tree the scripts are in share/portolan/launch_scripts; in the repository the programs are in install/bin.
BIN_FOLDERS = (HERE.parents[2] / "bin", HERE.parent / "install" / "bin")


def make_parser():
    parser = argparse.ArgumentParser(
        prog="run.sh", allow_abbrev=False,
        description="Runs Portolan's processes on a data set, waits for the end and leaves trajectories, map, summary.json and logs/ in OUT.",
        epilog="Exit code: 0 done, 2 bad arguments or input, 130 interrupted, else the first process's that failed. "
               "Ctrl-C ends the run in order; a second one kills.")
    add = parser.add_argument
    add("--data", action="append", default=[],
        help="data set folder (KITTI, TUM, EuRoC, images), video file, /dev/videoN, or 'topic' for the DDS image topic; with --robots once for each")
    add("--camera", metavar="FILE", help="calibration (default: found in the data set)")
    add("--out", required=True, metavar="DIR", help="where results go")
    add("--speed", default="1", help="1 (real time, default), another factor, max, or lockstep")
    add("--dds", choices=VENDORS, help="DDS vendor of all processes")
    for role in ROLES:
        add(f"--dds-{role.option}", choices=VENDORS, metavar="V", help=f"of {role.role} alone")
    add("--config", metavar="FILE", help="YAML configuration of all processes")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="overrides one value of the configuration; may be given again")
    add("--roles", default=",".join(role.option for role in ROLES), help="which processes to start here (default: %(default)s)")
    add("--standby", action="store_true", help="the roles started here wait to take the place of others that run; 'portolan swap ROLE', or when one dies")
    add("--robot", type=int, help="number of the robot, or of the first one")
    add("--robots", type=int, default=1, metavar="N", help="so many robots with one atlas_server; results of each in OUT/robot_NUMBER")
    add("--start-offset", type=float, default=0.0, metavar="S", help="seconds between the starts of two robots (default: 0)")
    add("--atlas", metavar="FILE", help="go on with a saved atlas (an atlas.db of an earlier run); without, one in OUT is set aside as atlas.db.before")
    add("--domain", type=int, help="DDS domain (default: a free one if all four start here, else the configuration's)")
    add("--peers", metavar="A,B", help="addresses of the other machines, where multicast does not reach")
    add("--security", metavar="DIR", help="keys that make_keys.py made: DDS Security is on, for processes of one vendor")
    add("--log-level", choices=LOG_LEVELS)
    add("--bin", type=pathlib.Path, metavar="DIR", help="folder of the programs (default: install/bin)")
    return parser


def fail(message):
    print(f"run.sh: {message}", file=sys.stderr)
    sys.exit(EXIT_USAGE)


def is_speed(text):
    if text in ("max", "lockstep"):
        return True
    try:
        factor = float(text)
    except ValueError:
        return False
    return math.isfinite(factor) and factor > 0


def check_data(data):
    if data == "topic":
        return
    if not os.path.exists(data):
        fail(f"--data {data}: no such folder, file or device")
    if not os.access(data, os.R_OK):
        fail(f"--data {data}: can't be read")


def check_file(option, path):
    if path is not None and not (os.path.isfile(path) and os.access(path, os.R_OK)):
        fail(f"{option} {path}: no such file, or it can't be read")


def check_security(options):
    if options.security is None:
        return
    for role in options.roles:
        if not os.path.isdir(os.path.join(options.security, role.role)):
            fail(f"--security {options.security}: holds no keys of {role.role}; make_keys.py makes them")
    vendors = {getattr(options, f"dds_{role.option}") or options.dds for role in options.roles}
    if len(vendors - {None}) > 1:
        fail("--security: processes of different DDS vendors can't be secured together; see docs/security.md")


def check_robots(options):
    """One --data for each robot whose frontend starts here."""
    check_range("--robots", options.robots, 1, MAX_ROBOTS)
    if options.robots > 1 and len(options.roles) < len(ROLES):
        fail("--robots: needs all roles on this machine; elsewhere start each robot with its --robot and a common dds.partition")
    if not (math.isfinite(options.start_offset) and options.start_offset >= 0):
        fail(f"--start-offset {options.start_offset}: expected seconds, 0 or more")
    check_range("--robot", options.robot, 0, MAX_ROBOT)
    check_range("the last robot's number", (options.robot or 0) + options.robots - 1, 0, MAX_ROBOT)
    if any(role.role == FRONTEND for role in options.roles):
        if not options.data:
            fail("--data is needed by the frontend")
        if len(options.data) != options.robots:
            fail(f"--data: given {len(options.data)} times for {options.robots} robot{'s' if options.robots > 1 else ''}")
    for data in options.data:
        check_data(data)


def check_range(option, value, low, high):
    if value is not None and not low <= value <= high:
        fail(f"{option} {value}: expected {low} to {high}")


def choose_roles(text):
    names = [name for name in text.split(",") if name]
    known = [role.option for role in ROLES]
    for name in names:
        if name not in known:
            fail(f"--roles: '{name}', expected some of {','.join(known)}")
    if not names:
        fail(f"--roles: none given, expected some of {','.join(known)}")
    return [role for role in ROLES if role.option in names]


def find_programs(options):
    """The folder of the programs: the one given, or the first of the usual ones that has them all."""
    names = [role.program for role in options.roles]
    for folder in [options.bin] if options.bin else BIN_FOLDERS:
        if all(os.access(folder / name, os.X_OK) for name in names):
            return folder.resolve()
    where = options.bin or " or ".join(str(folder) for folder in BIN_FOLDERS)
    fail(f"{', '.join(names)}: not all in {where}; run launch_scripts/build.sh first")
    return None


def is_domain_free(domain):
    """Whether nobody on this machine listens on the domain's discovery port: DDS shares it with SO_REUSEADDR, this probe does not."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", FIRST_PORT + PORTS_PER_DOMAIN * domain))
        except OSError:
            return False
    return True


def derive_domain(pid):
    """A domain that other runs on this machine don't use: by process number, on to the next while it is taken."""
    candidates = [1 + (pid + step) % MAX_DERIVED_DOMAIN for step in range(MAX_DERIVED_DOMAIN)]
    return next((domain for domain in candidates if is_domain_free(domain)), candidates[0])


def make_out(out):
    try:
        (out / "logs").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"--out {out}: {error.strerror}")
    for folder in (out, out / "logs"):
        if not os.access(folder, os.W_OK | os.X_OK):
            fail(f"--out {out}: {folder} is not writable")


def parse(arguments):
    """Options with everything checked, and OUT made; ends the program with EXIT_USAGE and a message otherwise."""
    options = make_parser().parse_args(arguments)
    options.roles = choose_roles(options.roles)
    options.peers = [peer.strip() for peer in (options.peers or "").split(",") if peer.strip()]
    if options.standby and any(role.role == FRONTEND for role in options.roles):
        fail("--standby: the frontend can't stand by; name other roles with --roles")
    check_robots(options)
    check_security(options)
    check_file("--camera", options.camera)
    check_file("--config", options.config)
    check_file("--atlas", options.atlas)
    if not is_speed(options.speed):
        fail(f"--speed {options.speed}: expected a factor above 0, max or lockstep")
    for assignment in options.set:
        if assignment.find("=") < 1:
            fail(f"--set {assignment}: expected key=value")
    check_range("--domain", options.domain, 0, MAX_DOMAIN)
    options.bin = find_programs(options)
    options.out = pathlib.Path(options.out).absolute()
    for folder in ["", *robot_folders(options)]:
        make_out(options.out / folder)
    if options.domain is None and len(options.roles) == len(ROLES):
        options.domain = derive_domain(os.getpid())
    return options


def robot_folders(options):
    """{folder below OUT: number of its robot}, in the order of their start; empty for a single robot, which has OUT for itself."""
    if options.robots == 1:
        return {}
    first = options.robot or 0
    return {f"robot_{number}": number for number in range(first, first + options.robots)}


def command_of(role, options, folder="", robot=None, data=None):
    """The command line of one process."""
    command = [str(options.bin / role.program), "--out", str(options.out / folder)]

    def add(option, value):
        if value is not None:
            command.extend([option, str(value)])

    add("--config", options.config)
    if options.robots > 1:
        add("--set", f"dds.partition={FLEET}")  # --set of the user's own comes after it
    for assignment in options.set:
        add("--set", assignment)
    if options.peers:
        add("--set", f"dds.peers=[{', '.join(options.peers)}]")
    add("--robot", robot)
    add("--domain", options.domain)
    add("--dds", getattr(options, f"dds_{role.option}") or options.dds)
    add("--security", None if options.security is None else os.path.abspath(options.security))
    add("--log-level", options.log_level)
    if options.standby:
        command.append("--standby")
    if role.role == ATLAS:
        add("--store", None if options.atlas is None else os.path.abspath(options.atlas))
    if role.role == FRONTEND:
        add("--data", data)
        add("--camera", options.camera)
        add("--speed", options.speed)
    return command


def commands_of(options):
    """({name: command line} in the order of their start, {name: seconds until its start}). Names: see launch_processes.Process."""
    folders = robot_folders(options)
    if not folders:
        data = options.data[0] if options.data else None
        return {role.role: command_of(role, options, robot=options.robot, data=data) for role in options.roles}, {}
    commands, delays = {}, {}
    for index, (folder, number) in enumerate(folders.items()):
        for role in options.roles:
            if role.role == ATLAS:
                commands[ATLAS] = commands.get(ATLAS) or command_of(role, options, robot=number)
                continue
            name = f"{folder}/{role.role}"
            commands[name] = command_of(role, options, folder, number, options.data[index])
            delays[name] = index * options.start_offset
    return commands, delays
