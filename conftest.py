"""Which tests run when, by their markers. See `make check` and `make test`.

- `real_time`: it promises something in real time. It runs alone, last. A test fails `in_time`, or
  waits in vain, while an empty loop was late, too. The machine was busy: it is skipped.
- `nodes`: it starts nodes, each test in a ROS domain of its own. `make check` leaves it out.
- `slow`: it takes more than a quarter of a second of a quiet core. `make check` leaves it out.
"""

from __future__ import annotations

import contextlib
import gc
import os
import re
import signal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from empty_loop import LATE_MS, EmptyLoop
from in_time import NotInTime
from ros_bench import FAILED

SRC = "tombo_ws/src/"
ORDER = (  # the mathematics first: the rest is built on it
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
    f"{SRC}tombo_benchmarks",
)
settings.register_profile("ci", settings.get_profile("ci"), max_examples=40)
settings.register_profile("few", settings.get_profile("ci"), max_examples=25)  # for `make check`

FAST = "not slow and not nodes and not real_time"
"""`-m` of `make check`."""

# The matrices are small: a second thread of BLAS doubles what a fit takes and ends it no sooner.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Modules stay: looking through them for garbage, again and again, takes a third of the collection.
gc.disable()


RUN = "TOMBO_TEST_RUN"
"""Environment of all that a run of the tests starts: the process number of pytest."""


def pytest_configure() -> None:
    """Mark what is started from here on."""
    os.environ.setdefault(RUN, str(os.getpid()))


def pytest_collection_finish() -> None:
    """Collect garbage again, of objects that the tests make."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test, and sort by `ORDER`; those in real time come last.

    Files without a fast test come first: no worker is left alone with one at the end.
    """
    for item in items:
        if "domain" in getattr(item, "fixturenames", ()):
            item.add_marker("nodes")
    have_fast = {item.path for item in items if not _marks(item) & {"slow", "nodes"}}

    def rank(item: pytest.Item) -> tuple[bool, bool, int]:
        order = next((i for i, f in enumerate(ORDER) if item.nodeid.startswith(f)), len(ORDER))
        return "real_time" in _marks(item), item.path in have_fast, order

    items.sort(key=rank)


def _marks(item: pytest.Item) -> set[str]:
    return {mark.name for mark in item.iter_markers()}


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave files unread of which `make check`, or the last part of `make test`, takes none."""
    wanted = config.option.markexpr
    if not collection_path.match("test_*.py") or wanted not in ("real_time", FAST):
        return None
    text = collection_path.read_text(encoding="utf-8")
    if wanted == "real_time":
        return None if "real_time" in text else True
    return True if re.search(r"^pytestmark = pytest\.mark\.(slow|real_time)", text, re.M) else None


LOOP = pytest.StashKey[EmptyLoop]()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let the empty loop run during a test in real time."""
    if item.get_closest_marker("real_time"):
        loop = item.config.stash.get(LOOP, None) or EmptyLoop()
        item.config.stash[LOOP] = item.stash[LOOP] = loop
        loop.begin()


def pytest_unconfigure(config: pytest.Config) -> None:
    """End the empty loop, and whatever an interrupted test has left running."""
    loop = config.stash.get(LOOP, None)
    if loop is not None:
        loop.close()
    if os.environ.get(RUN) == str(os.getpid()):  # not in a worker: others still run
        end_marked(f"{RUN}={os.getpid()}".encode())


def end_marked(mark: bytes) -> None:
    """Kill all other processes with a mark in their environment."""
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended, or is another user's
            if int(folder.name) != os.getpid() and mark in (folder / "environ").read_bytes():
                os.kill(int(folder.name), signal.SIGKILL)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[Any]) -> Any:
    """Remember which test has failed; skip one that was late where the machine was late, too."""
    report = yield
    if report.failed and call.excinfo is not None:
        item.stash[FAILED] = True
        loop = item.stash.get(LOOP, None)
        missed = isinstance(call.excinfo.value, NotInTime | TimeoutError)
        if missed and loop and loop.late_ms() > LATE_MS:
            why = call.excinfo.exconly().splitlines()[0]
            text = f"Skipped: the machine was late by {loop.late_ms():.0f} ms ({why})"
            report.outcome = "skipped"
            report.longrepr = (str(item.path), item.location[1], text)
    return report
