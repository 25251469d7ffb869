"""Where frames come from: the library libmotioncapture in a process of its own, or a topic."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import Any, Protocol

import numpy as np

from tombo_bag.rigid_bodies import BODY_LISTS
from tombo_bag.topics import POSE_TYPES
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_mocap.params import MocapParams
from tombo_mocap.tracked_poses import TrackedBody

_RESTART_S = 1.0
"""Wait before the library is started again after it has ended."""
_READ_BYTES = 1 << 16


class FrameSource(Protocol):
    """Something that has frames of rigid bodies."""

    fault: str
    """Why there are none; empty: nothing is known to be wrong."""

    def frames(self) -> list[list[TrackedBody]]:
        """Return the frames that have come since the last call, without waiting."""

    def close(self) -> None:
        """End it."""


class LibraryFrames:
    """Frames of libmotioncapture, which is started again whenever it ends."""

    def __init__(self, params: MocapParams) -> None:
        """Start it.

        Raises:
            InputError: the options are not KEY=VALUE.
        """
        options = {}
        for setting in params.options.split():
            key, equals, value = setting.partition("=")
            if not (key and equals):
                raise InputError(f"mocap.options: '{setting}'; accepted: KEY=VALUE")
            options[key] = value
        options = {"hostname": params.host} | options if params.host else options
        module = ["-m", "tombo_mocap.frame_reader", str(os.getpid())]
        self._command = [sys.executable, *module, params.system, json.dumps(options)]
        self.fault = ""
        self._rest = b""
        self._ended_s: float | None = None
        self._child = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        child = subprocess.Popen(self._command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert child.stdout is not None
        assert child.stderr is not None
        os.set_blocking(child.stdout.fileno(), False)
        os.set_blocking(child.stderr.fileno(), False)
        return child

    def frames(self) -> list[list[TrackedBody]]:
        """Return the frames that have come since the last call, without waiting."""
        *lines, self._rest = (self._rest + _read(self._child.stdout)).split(b"\n")
        if not lines and self._child.poll() is not None:
            self._restart()
        if lines:
            self.fault = ""
        return [_bodies_of_line(line) for line in lines]

    def _restart(self) -> None:
        now_s = time.monotonic()
        if self._ended_s is None:
            self._ended_s, self._rest = now_s, b""
            said = _read(self._child.stderr).decode("utf-8", "replace").strip().splitlines()
            self.fault = said[-1] if said else f"exit code {self._child.returncode}"
        elif now_s - self._ended_s > _RESTART_S:
            self._ended_s = None
            self.close()
            self._child = self._start()

    def close(self) -> None:
        """End it."""
        self._child.kill()
        self._child.wait()
        for stream in (self._child.stdout, self._child.stderr):
            if stream is not None:
                stream.close()


def _read(stream: Any) -> bytes:
    parts = []
    with contextlib.suppress(BlockingIOError):
        while part := os.read(stream.fileno(), _READ_BYTES):
            parts.append(part)
    return b"".join(parts)


def _bodies_of_line(line: bytes) -> list[TrackedBody]:
    arrival_ns, bodies = json.loads(line)
    return [
        TrackedBody(name, arrival_ns, np.array(pose[:3]), np.array(pose[3:]))
        for name, pose in bodies.items()
    ]


def bodies_of_message(
    typename: str, to_ns: Callable[[Any], int]
) -> Callable[[Any], list[TrackedBody]]:
    """Return a function that takes a driver's message apart.

    Args:
        typename: of `POSE_TYPES`, or one that holds several bodies.
        to_ns: stamp of a message → ns.

    Raises:
        InputError: a type without poses.
    """
    single, several = POSE_TYPES.get(typename), BODY_LISTS.get(typename)
    if single is None and several is None:
        raise InputError(
            f"poses of type {typename}; accepted: {', '.join((*POSE_TYPES, *BODY_LISTS))}"
        )

    def parts(message: Any) -> Iterator[tuple[str, Any, Any, Any]]:
        """Yield name, header, position and attitude of each body."""
        if single is not None:
            position, attitude = map(attrgetter, single)
            name = getattr(message, "child_frame_id", "")
            yield name, message.header, position(message), attitude(message)
        else:
            assert several is not None
            for body in attrgetter(several.sequence)(message):
                header = body.header if several.header.startswith("{body}") else message.header
                position, attitude = map(attrgetter, (several.position, several.attitude))
                name = str(attrgetter(several.name)(body)).strip("/")
                yield name, header, position(body), attitude(body)

    def bodies(message: Any) -> list[TrackedBody]:
        return [
            TrackedBody(name, to_ns(header.stamp), _array(p, "xyz"), _array(q, "xyzw"))
            for name, header, p, q in parts(message)
        ]

    return bodies


def _array(value: Any, axes: str) -> Array:
    return np.array([getattr(value, axis) for axis in axes])
