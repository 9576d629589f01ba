"""Starts processes, each in a process group of its own, watches over them and ends them in order."""

import os
import select
import signal
import subprocess
import sys
import time

from launch_arguments import FRONTEND

# What a process is told to end by, and the seconds it then has: an orderly end saves maps; the rest is for a process that hangs.
ENDING = ((signal.SIGINT, 20.0), (signal.SIGTERM, 5.0), (signal.SIGKILL, None))
LOG_LINES_SHOWN = 15
# A process must not outlive a launcher that was killed.
END_WITH_LAUNCHER = ("setpriv", "--pdeathsig", "TERM")
EXIT_FAILURE, EXIT_BAD_INPUT = 1, 2


def say(message):
    print(f"portolan: {message}", file=sys.stderr, flush=True)


def describe_code(code):
    """Popen's return code in words."""
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"code {code}"


def shell_code(code):
    """As a shell reports it: 128 + signal for a killed process."""
    return 128 - code if code < 0 else code


class Process:
    """One running process and how far its ending has gone. `name`: its role, or FOLDER/ROLE with a folder below OUT for its log."""

    def __init__(self, name, command, out):
        self.name = name
        folder, _, self.role = name.rpartition("/")
        self.output_path = out / folder / "logs" / f"{self.role}.out"
        with open(self.output_path, "wb") as output:
            # The frontend's progress goes to the terminal; whatever else is said, to the log folder.
            stdout = None if self.role == FRONTEND else output
            self.child = subprocess.Popen([*END_WITH_LAUNCHER, *command], stdin=subprocess.DEVNULL, stdout=stdout, stderr=output,
                                          process_group=0)
        self.code = None
        self.stage = -1  # index into ENDING of what it was told last
        self.deadline = None

    def reap(self):
        """True if it ended since the last call."""
        if self.code is not None or self.child.poll() is None:
            return False
        self.code = self.child.returncode
        return True

    def send(self, number):
        try:
            os.killpg(self.child.pid, number)
        except ProcessLookupError:
            pass  # it ended, to be reaped in a moment

    def end(self, first=None):
        """Tells it to end, by signal `first` if that is given; once."""
        if self.stage < 0 and self.code is None:
            self._tell(0, first)

    def kill(self):
        if self.code is None:
            self._tell(len(ENDING) - 1)

    def escalate(self, now):
        """The next harder signal when its time is over."""
        if self.deadline is None or self.code is not None or now < self.deadline:
            return
        say(f"{self.name} did not end within {ENDING[self.stage][1]:.0f} s: {ENDING[self.stage + 1][0].name}")
        self._tell(self.stage + 1)

    def last_lines(self):
        lines = self.output_path.read_text(errors="replace").rstrip().split("\n")
        return "\n".join(f"  {line}" for line in lines[-LOG_LINES_SHOWN:])

    def _tell(self, stage, number=None):
        self.stage = stage
        seconds = ENDING[stage][1]
        self.deadline = None if seconds is None else time.monotonic() + seconds
        self.send(number or ENDING[stage][0])


class Supervisor:
    """A run from its first process to its last. When the last frontend has ended, or a signal came and there is no frontend, the others are ended.

    A back end that fails is reported at once, and the run goes on: the others are made to survive it. But one that refuses what it was given (its part of the
    configuration, its store) ends the run, which would be another than was asked for.
    """

    def __init__(self, commands, out, delays=None):
        """commands: {name: command line}, in the order of their start; delays: {name: seconds until its start}, 0 for those that it lacks."""
        self.commands = commands
        self.out = out
        self.delays = delays or {}
        self.processes = {}
        self.waiting = {}   # {name: when to start it}, in the order of their start
        self.num_signals = 0
        self.failures = []  # (name, shell's code), in order
        self.codes = {}     # Popen's return codes

    def run(self):
        """Returns the exit code of the run."""
        wakeup, old_handlers = self._catch_signals()
        now = time.monotonic()
        self.waiting = {name: now + self.delays.get(name, 0.0) for name in self.commands}
        try:
            self._start_due()
            while self._running() or self.waiting:
                self._wait(wakeup)
                self._start_due()
        finally:
            for process in self._running():  # only after an exception
                process.kill()
            signal.set_wakeup_fd(-1)
            for number, handler in old_handlers.items():
                signal.signal(number, handler)
            os.close(wakeup)
            os.close(self._wakeup_writer)
        return self._exit_code()

    def _catch_signals(self):
        """Signals, and ends of children, arrive as bytes in a pipe: nothing polls, nothing races."""
        reader, self._wakeup_writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.set_wakeup_fd(self._wakeup_writer, warn_on_full_buffer=False)
        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGCHLD)
        return reader, {number: signal.signal(number, lambda *_: None) for number in numbers}

    def _start_due(self):
        for name in [name for name, start in self.waiting.items() if start <= time.monotonic()]:
            if name not in self.waiting:
                return  # the run was ended
            del self.waiting[name]
            try:
                self.processes[name] = Process(name, self.commands[name], self.out)
            except OSError as error:
                say(f"{name} can't be started: {error}")
                self.failures.append((name, EXIT_FAILURE))
                self._end_all()

    def _running(self):
        return [process for process in self.processes.values() if process.code is None]

    def _wait(self, wakeup):
        deadlines = [process.deadline for process in self._running() if process.deadline is not None] + list(self.waiting.values())
        timeout = max(0.0, min(deadlines) - time.monotonic()) if deadlines else None
        if select.select([wakeup], [], [], timeout)[0]:
            for number in os.read(wakeup, 4096):
                if number in (signal.SIGINT, signal.SIGTERM):
                    self._on_signal(signal.Signals(number))
        for process in self.processes.values():
            if process.reap():
                self._on_ended(process)
        for process in self._running():
            process.escalate(time.monotonic())

    def _on_signal(self, number):
        self.num_signals += 1
        frontends = [process for process in self._running() if process.role == FRONTEND]
        self.waiting.clear()
        if self.num_signals > 1:
            say("killing all processes")
            for process in self._running():
                process.kill()
        elif frontends:
            say(f"{number.name}: ending the run; once more kills it")
            for process in frontends:
                process.end(number)
        else:
            self._end_all()

    def _has_frontends(self):
        names = [*self.waiting, *(process.name for process in self._running())]
        return any(name.rpartition("/")[2] == FRONTEND for name in names)

    def _end_all(self):
        self.waiting.clear()
        for process in self._running():
            process.end()

    def _on_ended(self, process):
        self.codes[process.name] = process.code
        expected = process.stage >= 0 or process.role == FRONTEND
        if process.code != 0:
            self.failures.append((process.name, shell_code(process.code)))
            interrupted = self.num_signals > 0 and process.role == FRONTEND and shell_code(process.code) == 130
            if not interrupted:
                say(f"{process.name} failed ({describe_code(process.code)}); its last words, from {process.output_path}:\n"
                    f"{process.last_lines()}")
            if process.code == EXIT_BAD_INPUT and not expected:
                say("ending the run")
                self._end_all()
        elif not expected:
            say(f"{process.name} ended by itself; the run goes on")
        if process.role == FRONTEND and not self._has_frontends():  # another robot may go on in a map of this one's mapper
            self._end_all()

    def _exit_code(self):
        """That of bad input, if any process found some; else the first frontend's that is not 0, else the first failure's."""
        if any(code == EXIT_BAD_INPUT for _, code in self.failures):
            return EXIT_BAD_INPUT
        of_frontends = [code for name, code in self.failures if name.rpartition("/")[2] == FRONTEND]
        return next((code for code in [*of_frontends, *(code for _, code in self.failures)]), 0)
