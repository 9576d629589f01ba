#!/usr/bin/env python3
"""Runs Portolan: starts the processes, waits for the frontend's end, ends the others, writes summary.json. See run.sh --help."""

import shlex
import sys
import time

import launch_arguments
import launch_summary
from launch_processes import EXIT_FAILURE, Supervisor, say


def remove_old_reports(out, roles):
    """What an earlier run into the same folder left must not be taken for this run's."""
    for role in roles:
        (out / f"{role}.json").unlink(missing_ok=True)
        for log in (out / "logs").glob(f"{role}*"):
            log.unlink()
    (out / "summary.json").unlink(missing_ok=True)


def write_summary(options, arguments, supervisor, duration_s):
    reports, problems = launch_summary.read_reports(options.out, list(supervisor.commands))
    for problem in problems:
        say(problem)
    summary = launch_summary.merge(reports)
    summary["exit_codes"] = supervisor.codes
    summary["command"] = shlex.join(["run.sh", *arguments])
    summary["data"] = options.data
    summary["speed"] = options.speed
    summary["domain"] = options.domain
    summary["duration_s"] = round(duration_s, 3)
    launch_summary.write_json(options.out / "summary.json", summary)
    return summary


def main(arguments):
    options = launch_arguments.parse(arguments)
    commands = {role.role: launch_arguments.command_of(role, options) for role in options.roles}
    remove_old_reports(options.out, commands)
    domain = "the configuration's domain" if options.domain is None else f"domain {options.domain}"
    say(f"{', '.join(commands)} on {domain}; logs in {options.out / 'logs'}")
    supervisor = Supervisor(commands, options.out)
    started = time.monotonic()
    code = supervisor.run()
    try:
        summary = write_summary(options, arguments, supervisor, time.monotonic() - started)
    except OSError as error:
        say(f"{options.out / 'summary.json'}: {error.strerror}")
        return code or EXIT_FAILURE
    if options.data is not None:
        say(launch_summary.describe(summary))
    say(f"results in {options.out}")
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
