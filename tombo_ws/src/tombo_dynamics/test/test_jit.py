"""Machine code on disk: found again whatever path the sources are imported from."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import tombo_dynamics

CALL = """
from tombo_dynamics import input_check
print(input_check.__file__, input_check.is_future(6_000_000, 0), input_check.is_future(5, 0))
"""


@pytest.mark.slow
def test_the_same_sources_under_another_path_are_not_compiled_again(tmp_path: Path) -> None:
    said = []
    for name in ("built", "installed"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "tombo_dynamics").symlink_to(Path(tombo_dynamics.__file__).parent)
        path = os.pathsep.join([str(tmp_path / name), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": path, "TOMBO_CACHE_DIR": str(tmp_path / "kept")}
        environment.pop("NUMBA_DISABLE_JIT", None)
        done = subprocess.run(
            [sys.executable, "-c", CALL],
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.split() == [
            str(tmp_path / name / "tombo_dynamics" / "input_check.py"), "True", "False"
        ]  # fmt: skip
        said.append(done.stderr.count("tombo: compiling"))

    assert said == [1, 0]
