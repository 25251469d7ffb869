"""Which tests run when: decided here, for all of them. See `make check` and `make test`.

- `alone`: it waits on the wall clock, or starts nodes or processes whose time counts. One at a
  time, last.
- `real_time`: one of those that promises something in real time. Where it fails and a loop beside
  it that does nothing was late, too, the machine was taken away: it is skipped.
- `slow`: it takes seconds. `make check` leaves it out.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest

from empty_loop import LATE_MS, EmptyLoop
from ros_bench import FAILED

ROOT = Path(__file__).parent
SRC = "tombo_ws/src/"
ORDER = (  # the mathematics first: it is fast, and the rest is built on it
    "tests/structure",
    f"{SRC}tombo_dynamics",
    f"{SRC}tombo_control",
    f"{SRC}tombo_collision",
    f"{SRC}tombo_sim",
    f"{SRC}tombo_bag",
    f"{SRC}tombo_px4",
    f"{SRC}tombo_diagnosis",
    f"{SRC}tombo_propeller",
    f"{SRC}tombo_flight",
    f"{SRC}tombo_bringup",
)
REAL_TIME_FIXTURES = {"domain"}  # nodes
REAL_TIME = (
    "tests/nodes/",
    "tests/replay/test_through_nodes.py",
    f"{SRC}tombo_bringup/test/cli/test_fly_nodes.py",
    f"{SRC}tombo_bringup/test/cli/test_fly_px4.py",
    f"{SRC}tombo_bringup/test/cli/test_run_command.py",
    f"{SRC}tombo_bringup/test/cli/test_stop.py",
    f"{SRC}tombo_bringup/test/cli/test_up_command.py",
    f"{SRC}tombo_bringup/test/test_hil_command.py",
    f"{SRC}tombo_bringup/test/test_px4_command.py",
    f"{SRC}tombo_flight/test/suite/test_supervisor.py",
    f"{SRC}tombo_px4/test/autopilot/test_endpoint_serve.py",
    f"{SRC}tombo_px4/test/autopilot/test_hil_lockstep.py",
    f"{SRC}tombo_px4/test/autopilot/test_mavsdk.py",
    f"{SRC}tombo_px4/test/bridge/test_transport.py",
    f"{SRC}tombo_ros/test/test_record_parameters.py",
)
ALONE = ("tests/docker/test_scripts.py", "tests/setup/test_setup_script.py")
SLOW = tuple((ROOT / "tests" / "slow_tests.txt").read_text().split())
"""Folders, files and functions that take more than 0.2 s of a quiet core."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test, and sort by `ORDER`; those that run alone come last."""
    rank = {}
    for item in items:
        name = item.nodeid.partition("[")[0]
        nodes = REAL_TIME_FIXTURES & {*getattr(item, "fixturenames", ())}
        if nodes or name.startswith(REAL_TIME):
            item.add_marker("real_time")
            item.add_marker("alone")
        elif name.startswith(ALONE):
            item.add_marker("alone")
        elif name in SLOW or any(name.startswith(s) for s in SLOW if "::" not in s):
            item.add_marker("slow")
        order = next((i for i, folder in enumerate(ORDER) if name.startswith(folder)), len(ORDER))
        rank[item] = (item.get_closest_marker("alone") is not None, order)
    items.sort(key=rank.__getitem__)


LOOP = pytest.StashKey[EmptyLoop]()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let the empty loop run beside a test in real time."""
    if item.get_closest_marker("real_time"):
        loop = item.config.stash.get(LOOP, None) or EmptyLoop()
        item.config.stash[LOOP] = item.stash[LOOP] = loop
        loop.begin()


def pytest_unconfigure(config: pytest.Config) -> None:
    """End the empty loop."""
    loop = config.stash.get(LOOP, None)
    if loop is not None:
        loop.close()


MISSED = (AssertionError, TimeoutError, subprocess.TimeoutExpired, pytest.fail.Exception)
"""How a test says that a promise was not kept; another exception is a defect at any speed."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[Any]) -> Any:
    """Remember which test has failed; skip it where the machine was taken away."""
    report = yield
    if report.failed and call.excinfo is not None:
        item.stash[FAILED] = True
        loop = item.stash.get(LOOP, None)
        if (
            loop is not None
            and loop.late_ms() > LATE_MS
            and isinstance(call.excinfo.value, MISSED)
        ):
            why = call.excinfo.exconly().splitlines()[0]
            text = f"Skipped: the machine was late by {loop.late_ms():.0f} ms ({why})"
            report.outcome = "skipped"
            report.longrepr = (str(item.path), item.location[1], text)
    return report
