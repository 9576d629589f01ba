#!/usr/bin/env python3
"""Runs Portolan: starts the processes, waits for the frontend's end, ends the others, writes summary.json. See run.sh --help."""

import shlex
import sys
import time

import launch_arguments
import launch_summary
from launch_processes import EXIT_FAILURE, Supervisor, say


def remove_old_reports(out, names):
    """What an earlier run into the same folder left must not be taken for this run's."""
    for name in names:
        (out / f"{name}.json").unlink(missing_ok=True)
        folder, _, role = name.rpartition("/")
        for log in (out / folder / "logs").glob(f"{role}*"):
            log.unlink()
        (out / folder / "summary.json").unlink(missing_ok=True)
    (out / "summary.json").unlink(missing_ok=True)


def set_old_atlas_aside(options, commands):
    """A run makes maps of its own unless it is told to go on with others. Atlas_servers started without a frontend always go on."""
    has_frontend = any(name.rpartition("/")[2] == launch_arguments.FRONTEND for name in commands)
    if options.atlas is not None or not has_frontend or not (options.out / "atlas.db").exists():
        return
    for suffix in ("", "-wal"):  # SQLite's log belongs to the file
        old, kept = options.out / f"atlas.db{suffix}", options.out / f"atlas.db.before{suffix}"
        kept.unlink(missing_ok=True)
        if old.exists():
            old.rename(kept)
    say(f"an earlier run's atlas is kept as {options.out / 'atlas.db.before'}; --atlas FILE goes on with one")


def summarize(options, supervisor, folder="", data=None):
    """The figures of OUT, or of one robot's folder in it, merged and written into its summary.json."""
    names = [name for name in supervisor.commands if name.rpartition("/")[0] == folder]
    reports, problems = launch_summary.read_reports(options.out / folder, [name.rpartition("/")[2] for name in names])
    for problem in problems:
        say(problem)
    summary = launch_summary.merge(reports)
    summary["exit_codes"] = {name.rpartition("/")[2]: supervisor.codes[name] for name in names if name in supervisor.codes}
    summary["data"] = data
    return summary


def write_summary(options, arguments, supervisor, duration_s):
    folders = launch_arguments.robot_folders(options)
    summary = summarize(options, supervisor, data=options.data[0] if options.data and not folders else None)
    if folders:
        robots = {folder: summarize(options, supervisor, folder, data) for folder, data in zip(folders, options.data)}
        summary = launch_summary.merge_robots(summary, robots)
        for folder, robot in robots.items():
            launch_summary.write_json(options.out / folder / "summary.json", robot)
    summary["command"] = shlex.join(["run.sh", *arguments])
    summary["speed"] = options.speed
    summary["domain"] = options.domain
    summary["duration_s"] = round(duration_s, 3)
    launch_summary.write_json(options.out / "summary.json", summary)
    return summary


def main(arguments):
    options = launch_arguments.parse(arguments)
    commands, delays = launch_arguments.commands_of(options)
    remove_old_reports(options.out, commands)
    set_old_atlas_aside(options, commands)
    domain = "the configuration's domain" if options.domain is None else f"domain {options.domain}"
    say(f"{', '.join(commands)} on {domain}; logs in {options.out / 'logs'}")
    supervisor = Supervisor(commands, options.out, delays)
    started = time.monotonic()
    code = supervisor.run()
    try:
        summary = write_summary(options, arguments, supervisor, time.monotonic() - started)
    except OSError as error:
        say(f"{options.out / 'summary.json'}: {error.strerror}")
        return code or EXIT_FAILURE
    if options.data:
        say(launch_summary.describe(summary))
    say(f"results in {options.out}")
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
