"""Virtual environments of other simulators: their numpy, scipy and JAX are others than ours."""

from __future__ import annotations

import subprocess
import sys
import venv
from collections.abc import Callable
from pathlib import Path
from typing import Final

from tombo_dynamics.errors import InputError

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
