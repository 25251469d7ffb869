"""Starts programs, watches them, and ends all of them with the supervisor.

Each runs in a session of its own, so Ctrl-C reaches it once and through the supervisor. No node is
restarted: a flight with a node that came back is another experiment.

The log of a node is a file that the node writes and the supervisor reads: its own standard output
and error, so a supervisor that is busy, stopped or gone never holds up a node.
"""

from __future__ import annotations

import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tombo_dynamics import launcher
from tombo_flight.suite import guard

_LAST_S: Final = 1.0
"""From the request to stop [s]: programs that end last wait no longer for the others."""
_ESCALATION: Final = ((2.0, signal.SIGTERM), (2.5, signal.SIGKILL))
"""Time after the request to stop [s], and the signal that running programs get then."""
_LOOK_S = 0.01
_PIPE_BYTES = 1 << 16
_IMPORTANT = re.compile(r"\[(WARN|ERROR|FATAL)\]|Error: ")
_LINE = re.compile(r"\[(\w+)\] \[[\d.]+\] \[[^\]]*\]: (.*)")
_LAST_LOG_LINES = 8
_MOST_SHOWN = 10
"""Warnings and errors that are shown at a time: the file has all."""


@dataclass(frozen=True)
class Program:
    """A program to run.

    Attributes:
        name: its log is `<name>.log`.
        command: absolute path of the executable, and arguments.
        capture_stdout: its standard output is not logged but returned by `Supervisor.poll`, and
            `Supervisor.send` writes to its standard input.
        ends_last: it is asked to end when the others have ended, so it still receives what they
            have sent.
    """

    name: str
    command: tuple[str, ...]
    capture_stdout: bool = False
    ends_last: bool = False


@dataclass(frozen=True)
class ProcessExit:
    """A program that has come to its end.

    Attributes:
        name: of the program.
        code: exit code; below 0 the number of the signal that ended it.
        last_log_lines: the last lines of its log.
    """

    name: str
    code: int
    last_log_lines: tuple[str, ...]

    @property
    def exit_text(self) -> str:
        """How it ended, as text."""
        if self.code >= 0:
            return f"exit code {self.code}"
        try:
            return f"killed by {signal.Signals(-self.code).name}"
        except ValueError:
            return f"killed by signal {-self.code}"


@dataclass(frozen=True)
class ProcessUpdate:
    """Changes since the last poll.

    Attributes:
        ended: programs that have ended since the last look.
        warnings: (name, line) of logs: warnings and errors.
        lines: (name, line) of programs that are listened to.
    """

    ended: list[ProcessExit]
    warnings: list[tuple[str, str]]
    lines: list[tuple[str, str]]


def without_stamp(line: str) -> str:
    """Return a line of a ROS log as level and text, without node name and time."""
    match = _LINE.fullmatch(line)
    return line if match is None else f"{match[1]} {match[2]}"


class NodeLog:
    """The log of one node, at `path`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._place = 0
        self._rest = b""
        self._last: deque[str] = deque(maxlen=_LAST_LOG_LINES)

    def open(self) -> int:
        """Make the file and return a descriptor for the node to write to."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
        return os.open(self.path, flags, 0o644)

    @property
    def last_log_lines(self) -> tuple[str, ...]:
        """The last lines that were read."""
        return tuple(self._last)

    def news(self) -> list[str]:
        """Read new lines; return the warnings and errors, of many the first, and their number."""
        lines = self._read()
        self._last.extend(lines)
        important = [line for line in lines if _IMPORTANT.match(line)]
        more = len(important) - _MOST_SHOWN
        return important[:_MOST_SHOWN] + ([f"... {more} more in {self.path}"] if more > 0 else [])

    def _read(self) -> list[str]:
        """Return the whole lines since the last call."""
        with self.path.open("rb") as file:
            file.seek(self._place)
            data = file.read()
            self._place = file.tell()
        *whole, self._rest = (self._rest + data).split(b"\n")
        lines = (line.decode("utf-8", "replace").rstrip() for line in whole)
        return [line for line in lines if line]


@dataclass
class _Child:
    program: Program
    process: subprocess.Popen[bytes]
    log: NodeLog
    pipe: int | None
    rest: bytes = b""


class Supervisor:
    """Use as a context manager: leaving it, by error or not, ends all programs within 3 s.

    An exception while they are being stopped, as KeyboardInterrupt, kills them at once. Should the
    supervisor itself be killed, the kernel and the guard end them (see `launcher`, `guard`).
    """

    def __init__(
        self, programs: Sequence[Program], folder: Path, environment: Mapping[str, str]
    ) -> None:
        """Prepare.

        Args:
            programs: what to run.
            folder: of the logs; made when it isn't there.
            environment: of the programs.
        """
        self._programs = tuple(programs)
        self._folder = folder
        self._environment = dict(environment)
        self._alive: dict[str, _Child] = {}
        self._guard: subprocess.Popen[bytes] | None = None
        self._stop_requested = False

    @property
    def running(self) -> dict[str, int]:
        """Name → process number of what runs."""
        return {name: child.process.pid for name, child in self._alive.items()}

    def __enter__(self) -> Supervisor:
        """Start all programs."""
        self._folder.mkdir(parents=True, exist_ok=True)
        try:
            self._guard = subprocess.Popen(
                [sys.executable, "-I", "-S", guard.__file__],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                cwd="/",
            )
            for program in self._programs:
                self._alive[program.name] = self._start(program)
        except BaseException:
            self._kill()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        """End the programs that still run."""
        try:
            if not self._stop_requested:  # else it was interrupted: no more patience
                self.stop()
        finally:
            self._kill()

    def poll(self, wait_s: float) -> ProcessUpdate:
        """Wait for a while, or until a program that is listened to prints; return the changes."""
        lines = self._read_pipes(wait_s)
        ended = self._reap()
        children = [*self._alive.values(), *(child for child, _ in ended)]
        warnings = [(c.program.name, line) for c in children for line in c.log.news()]
        return ProcessUpdate(
            [_process_exit(child, code) for child, code in ended], warnings, lines
        )

    def send(self, name: str, line: str) -> bool:
        """Write a line to a program that is listened to; False: it does not run."""
        child = self._alive.get(name)
        if child is None or child.process.stdin is None:
            return False
        try:
            os.write(child.process.stdin.fileno(), f"{line}\n".encode())
        except OSError:  # it has closed it, or reads nothing any more
            return False
        return True

    def stop(self) -> list[ProcessExit]:
        """End all programs: SIGINT, 2 s later SIGTERM, at last SIGKILL; return how they ended."""
        began = time.monotonic()
        self._stop_requested = True
        ended: list[tuple[_Child, int]] = []
        last = {name for name, child in self._alive.items() if child.program.ends_last}

        def wait(for_what: Callable[[], object], until_s: float) -> None:
            while for_what() and time.monotonic() - began < until_s:
                self._read_pipes(_LOOK_S)
                ended.extend(self._reap())

        self._signal(signal.SIGINT, self._alive.keys() - last)
        if last:
            wait(lambda: self._alive.keys() - last, _LAST_S)
            self._signal(signal.SIGINT, last)
        for after_s, number in _ESCALATION:
            wait(lambda: self._alive, after_s)
            self._signal(number, self._alive)
        while self._alive:
            time.sleep(_LOOK_S)
            ended += self._reap()
        for child, _ in ended:
            child.log.news()
        return [_process_exit(child, code) for child, code in ended]

    def _start(self, program: Program) -> _Child:
        if self._guard is None or self._guard.stdin is None:
            raise RuntimeError("a program needs a guard")
        log = NodeLog(self._folder / f"{program.name}.log")
        file = log.open()
        try:
            fd = self._guard.stdin.fileno()
            process = subprocess.Popen(
                [
                    *(sys.executable, "-I", "-S", launcher.__file__),
                    *(str(os.getpid()), str(fd)),
                    *program.command,
                ],
                stdin=subprocess.PIPE if program.capture_stdout else subprocess.DEVNULL,
                stdout=subprocess.PIPE if program.capture_stdout else file,
                stderr=file,
                start_new_session=True,
                pass_fds=(fd,),
                env=self._environment,
            )
        finally:
            os.close(file)
        pipe = None
        if process.stdout is not None:
            pipe = process.stdout.fileno()
            os.set_blocking(pipe, False)
        if process.stdin is not None:
            os.set_blocking(process.stdin.fileno(), False)
        return _Child(program, process, log, pipe)

    def _read_pipes(self, wait_s: float) -> list[tuple[str, str]]:
        """Wait for output, at most so long, and return the whole lines."""
        pipes = {c.pipe: c for c in self._alive.values() if c.pipe is not None}
        ready, _, _ = select.select(list(pipes), [], [], wait_s)
        lines: list[tuple[str, str]] = []
        for pipe in ready:
            lines += self._lines(pipes[pipe])
        return lines

    def _lines(self, child: _Child) -> list[tuple[str, str]]:
        if child.pipe is None:
            return []
        try:
            data = os.read(child.pipe, _PIPE_BYTES)
        except BlockingIOError:
            return []
        if not data:  # closed: its end comes, or it only stopped talking
            child.pipe = None
            return []
        *whole, child.rest = (child.rest + data).split(b"\n")
        return [(child.program.name, line.decode("utf-8", "replace")) for line in whole]

    def _reap(self) -> list[tuple[_Child, int]]:
        """Reap what has ended, and end what it left in its session; return (child, exit code)."""
        found = []
        for name, child in list(self._alive.items()):
            pid = child.process.pid
            if not _has_ended(pid):
                continue
            _signal_group(pid, signal.SIGKILL)  # before it is reaped: the number is still its own
            code = child.process.wait()
            self._notify_guard(-pid)
            for pipe in (child.process.stdin, child.process.stdout):
                if pipe is not None:
                    pipe.close()
            del self._alive[name]
            found.append((child, code))
        return found

    def _signal(self, number: signal.Signals, names: Iterable[str]) -> None:
        for name in self._alive.keys() & set(names):
            _signal_group(self._alive[name].process.pid, number)

    def _kill(self) -> None:
        """End everything now, the guard last."""
        self._signal(signal.SIGKILL, self._alive)
        while self._alive:
            self._reap()
            time.sleep(0.001)
        if self._guard is not None:
            try:
                self._guard.communicate()
            except OSError:  # it has been killed: its pipe is broken
                self._guard.wait()

    def _notify_guard(self, group: int) -> None:
        if self._guard is None or self._guard.stdin is None:
            return
        try:
            os.write(self._guard.stdin.fileno(), f"{group}\n".encode())
        except OSError:  # it has been killed; the kernel's arrangement remains
            return


def _process_exit(child: _Child, code: int) -> ProcessExit:
    return ProcessExit(child.program.name, code, child.log.last_log_lines)


def json_object(line: str) -> dict[str, Any]:
    """Return the JSON object that a program said in a line; empty: it is none."""
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _has_ended(pid: int) -> bool:
    """Return whether a child has ended; it is not reaped yet, so its number is not given away."""
    try:
        return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:
        return True


def _signal_group(group: int, number: signal.Signals) -> None:
    try:
        os.killpg(group, number)
    except (ProcessLookupError, PermissionError):
        return
