"""docs/px4.md says what there is: its tests, parameters, files and tables."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tombo_px4.autopilot.parameters import PARAMETERS
from tombo_px4.bridge.checklist import CHECKS
from tombo_px4.bridge.vehicle_parameters import MOCAP_ONLY

ROOT = Path(__file__).parents[4]
PAGE = (ROOT / "docs" / "px4.md").read_text()
FAULTS = (ROOT / "docs" / "faults.md").read_text().split("## PX4 bridge")[1].split("\n## ")[0]
TESTS = "\n".join(path.read_text() for path in ROOT.glob("t*/**/test_*.py"))


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(test_\w+)`", FAULTS))))
def test_a_test_that_is_named_is_there(name: str):
    assert f"def {name}(" in TESTS


def test_every_fault_has_a_test():
    rows = [line for line in FAULTS.splitlines() if line.startswith("| ")][1:]
    assert len(rows) > 15
    assert all("`test_" in row for row in rows)


def test_a_fault_that_is_named_is_one_of_the_bridge():
    folder, checks = ROOT / "tombo_ws/src/tombo_px4/tombo_px4", {check.key for check in CHECKS}
    source = "\n".join(path.read_text() for path in folder.rglob("*.py"))
    for column in re.findall(r"^\| [^|]+ \| (`[^|]+`) \| [^|]+ \| `test_", FAULTS, re.M):
        for key in re.findall(r"`([\w.]+)`", column):
            check = key.removeprefix("check.")
            assert (check in checks) if check != key else f'"{key}"' in source, key


def test_the_parameters_for_mocap_are_those_that_are_set():
    rows = re.findall(r"^\| (`[A-Z].*?) \| ([^|]+) \|", PAGE, re.M)
    told = {}
    for names, values in rows:
        columns = re.findall(r"`(\w+)`", names)
        given = [int(value) for value in re.findall(r"-?\d+", values)]
        told |= dict(zip(columns, given if len(given) == len(columns) else len(columns) * given))  # noqa: B905
    assert told.items() >= MOCAP_ONLY.items()
    known = {p.name for p in PARAMETERS}
    assert set(told) <= known
