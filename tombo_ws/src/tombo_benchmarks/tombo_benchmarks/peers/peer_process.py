"""Another simulator in a process of its own: orders go to it, answers come back, as JSON lines."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import tombo_benchmarks
from tombo_dynamics.errors import InputError

_SCRIPTS: Final = Path(tombo_benchmarks.__file__).parents[1] / "scripts" / "peers"
_MARK: Final = "answer "
"""As `scripts/peers/peer_worker.py` has it."""


class PeerProcess:
    """A simulator that flies when it is asked to, and waits idly in between.

    Raises:
        InputError: it does not start, or ends before it has answered.
    """

    def __init__(self, name: str, python: Path, order: Mapping[str, Any]) -> None:
        self.name = name
        self._folder = tempfile.TemporaryDirectory()
        home = Path(self._folder.name)
        (home / "order.json").write_text(json.dumps(order))
        self._errors = (home / "errors.txt").open("w+")
        self._process = subprocess.Popen(
            [python, _SCRIPTS / f"{name}_course.py", home / "order.json"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True,
            cwd=home,  # for the logs that it writes
            env={k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
            | {"JAX_PLATFORMS": "cpu"},
        )  # fmt: skip
        try:
            self.versions: dict[str, str] = self._answer()["versions"]
        except InputError:
            self.close()
            raise

    def ask(self, action: str, **arguments: Any) -> dict[str, Any]:
        """Return the answer to an action of the script.

        Raises:
            InputError: the process has ended.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps({"do": action, **arguments}) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # `_answer` says why
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(_MARK):
                answer: dict[str, Any] = json.loads(line.removeprefix(_MARK))
                return answer
        self._errors.seek(0)
        last = self._errors.read().strip().splitlines()[-1:] or ["no message"]
        raise InputError(f"'{self.name}' ended: {last[0]}; accepted: an environment that runs it")

    def close(self) -> None:
        """End the process."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._errors.close()
        self._folder.cleanup()

    def __enter__(self) -> PeerProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


PEERS: Final = {
    "rotorpy": ("rotorpy==3.0.0",),
    "crazyflow": ("crazyflow==0.4.0", "jax==0.10.1", "jaxlib==0.10.1"),
}
"""Name of a simulator → what pip installs into its environment."""


def default_folder() -> Path:
    """Return where the environments are kept: beside the compiled code, in this environment."""
    return Path(sys.prefix) / "var" / "tombo_peers"


def peer_python(folder: Path, peer: str) -> Path | None:
    """Return the Python of a simulator's environment in a folder; None: it is not there."""
    home = folder / f"venv-{peer}"
    return home / "bin" / "python" if (home / "installed").exists() else None


def make_environment(folder: Path, peer: str, progress: Callable[[str], None]) -> Path:
    """Return the Python of a simulator's environment in a folder, made if it is not there yet.

    Raises:
        InputError: pip can't install it.
    """
    python = peer_python(folder, peer)
    if python is not None:
        return python
    home = folder / f"venv-{peer}"
    progress(f"installing {', '.join(PEERS[peer])} into {home}")
    venv.create(home, with_pip=True, clear=True)
    python = home / "bin" / "python"
    command = [str(python), "-m", "pip", "install", "--quiet", *PEERS[peer]]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        reasons = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        raise InputError(
            f"'{peer}': no environment in '{home}': {' '.join(reasons[-2:]) or 'pip failed'}; "
            f"accepted: a package index that has {' and '.join(PEERS[peer])}"
        )
    (home / "installed").write_text("\n".join(PEERS[peer]) + "\n")
    return python
