"""Makes `reports` importable; fixtures: those of `ros_bench`, and a flight in real time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ros_bench import domain, start, world

__all__ = ["domain", "flight_run", "start", "world"]


@pytest.fixture(scope="module")
def flight_run(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    """Fly the module's FLIGHT: `tombo fly` with these arguments; its folder and its figures."""
    folder = tmp_path_factory.mktemp("flight") / "flown"
    command = [sys.executable, "-m", "tombo_bringup.cli.main", "fly", *request.module.FLIGHT]
    run = subprocess.run(
        [*command, "-o", str(folder), "--json"], capture_output=True, text=True, timeout=240
    )
    assert run.returncode == 0, run.stderr
    return folder, json.loads(run.stdout)
