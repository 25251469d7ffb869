"""The guided first flight against the simulated PX4, with labs that have a fault."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import yaml

STEPS = ["lab", "mocap", "clocks", "parameters", "battery", "kill_switch", "geofence", "rotors"]


def test_faults_of_a_lab_are_stopped_before_anything_arms(domain: int, tmp_path: Path) -> None:
    """The motors of one lab are exchanged, another has no volume; a program is the person."""
    faults = {"wrong order of rotors": STEPS, "volume missing": ["lab"]}
    command = [sys.executable, "-m", "tombo_benchmarks.px4", "--simulated", "--first-flight"]
    rows = [word for fault in faults for word in ("--row", fault)]
    run = subprocess.run(
        [*command, "--quick", "--keep", str(tmp_path / "labs"), *rows],
        capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    for fault, wanted in faults.items():
        folder = tmp_path / "labs" / fault.replace(" ", "_") / "flight"
        steps = yaml.safe_load((folder / "first_flight.yaml").read_text())["steps"]
        assert list(steps) == wanted
        assert [key for key in wanted if not steps[key]["passed"]] == [wanted[-1]]
        row = next(line for line in run.stdout.splitlines() if line.startswith(f"| {fault} |"))
        assert row.endswith("| no | yes |"), row  # never armed, by PX4's heartbeats
