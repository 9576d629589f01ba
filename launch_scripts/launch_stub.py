"""Stands for one of Portolan's programs in test_launch.py. What it does is in PORTOLAN_STUB: JSON {role: behaviour}, with the keys
wait: "signal" (SIGINT or SIGTERM), "up" (until so many others said that they are up: `others`) or "file" (`path`, a FIFO to read from);
announce: so many bytes (true: one) into the FIFO PORTOLAN_STUB_UP, to say that it is up; ignore: signals to ignore; code: exit code (default 0); say: a line for
stderr; report: JSON object to leave in OUT (none: no file)."""

import json
import os
import pathlib
import signal
import sys


def wait_for(behaviour, up):
    if behaviour.get("announce"):
        with open(up, "w") as fifo:  # blocks until somebody reads
            fifo.write("u" * behaviour["announce"])
    kind = behaviour.get("wait")
    if kind == "signal":
        ignored = {signal.Signals[name] for name in behaviour.get("ignore", [])}
        signal.sigwait({signal.SIGINT, signal.SIGTERM, signal.SIGUSR1} - ignored)
    elif kind == "up":
        fifo = os.open(up, os.O_RDWR)  # also for writing: so there is no end of file between two writers
        for _ in range(behaviour["others"]):
            os.read(fifo, 1)
    elif kind == "file":
        pathlib.Path(behaviour["path"]).read_text()


def main():
    role = pathlib.Path(sys.argv[0]).name.replace("portolan_", "")
    behaviour = json.loads(os.environ["PORTOLAN_STUB"])[role]
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGUSR1})  # they wait for sigwait
    out = pathlib.Path(sys.argv[sys.argv.index("--out") + 1])
    (out / f"{role}.arguments").write_text(json.dumps(sys.argv[1:]))
    wait_for(behaviour, os.environ["PORTOLAN_STUB_UP"])
    if "say" in behaviour:
        print(behaviour["say"], file=sys.stderr)
    if "report" in behaviour:
        (out / f"{role}.json").write_text(json.dumps(behaviour["report"]))
    sys.stderr.flush()
    os._exit(behaviour.get("code", 0))


main()
