"""A PX4 SITL that was built from its sources: found, started in a folder of its own, ended."""

from __future__ import annotations

import os
import socket
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from tombo_dynamics.errors import InputError
from tombo_px4.hil.flight import AIRFRAME

LOG: Final = "px4.txt"
_TARGET: Final = Path("build/px4_sitl_default")
_START: Final = "etc/init.d-posix/rcS"
_END_S = 5.0


def px4_build(folder: Path) -> Path:
    """Return the build of a PX4 SITL: the folder itself, or that of its source tree.

    Raises:
        InputError: there is none.
    """
    for build in (folder, folder / _TARGET):
        if (build / "bin/px4").is_file() and (build / _START).is_file():
            return build.resolve()
    raise InputError(
        f"'{folder}': no PX4 SITL; accepted: PX4's source tree with {_TARGET}, or that folder"
    )


class Px4Process:
    """A running PX4; use as a context manager."""

    def __init__(
        self, build: Path, folder: Path, parameters: Mapping[str, float], instance: int = 0
    ) -> None:
        """Prepare it.

        Args:
            build: `px4_build`.
            folder: for its parameters, which it finds again, and its logs.
            parameters: of PX4, at its start.
            instance: PX4's: ports are 4560 and 14540 plus this, the system's id this plus 1.
        """
        self._build, self._folder, self._instance = build, folder, instance
        settings = {f"PX4_PARAM_{name}": f"{value:g}" for name, value in parameters.items()}
        self._environment = {**os.environ, **AIRFRAME, **settings}
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Px4Process:
        """Start it."""
        self._folder.mkdir(parents=True, exist_ok=True)
        _forget_dead(self._instance)
        command = [str(self._build / "bin/px4"), "-d", "-i", str(self._instance), "-s", _START]
        command += ["-w", ".", str(self._build / "etc")]
        with (self._folder / LOG).open("wb") as log:
            self._process = subprocess.Popen(
                command, cwd=self._folder, env=self._environment, stdin=subprocess.DEVNULL,
                stdout=log, stderr=subprocess.STDOUT,
            )  # fmt: skip
        return self

    @property
    def running(self) -> bool:
        """It has not ended by itself."""
        return self._process is not None and self._process.poll() is None

    def __exit__(self, *error: object) -> None:
        """End it."""
        process = self._process
        if process is None:
            return
        process.terminate()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        _forget_dead(self._instance)


def _forget_dead(instance: int) -> None:
    """Remove the socket of a PX4 that has died: with it, another one would not start."""
    path = Path(f"/tmp/px4-sock-{instance}")
    if not path.exists():
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink(missing_ok=True)
        else:
            raise InputError(f"PX4 instance {instance} runs already; accepted: another instance")
