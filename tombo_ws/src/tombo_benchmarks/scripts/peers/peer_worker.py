"""What the processes of other simulators share: orders come as JSON lines, so do the answers.

A process gets the vehicle and the course as a JSON file (`tombo_benchmarks/peers/course.py` says
what is in it). Needs numpy alone.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

Order = dict[str, Any]
MARK = "answer "
"""Before each answer, among whatever a simulator prints."""


def read_order() -> Order:
    """Return the vehicle and the course."""
    order: Order = json.loads(Path(sys.argv[1]).read_text())
    return order


def timed(fly: Callable[[], int]) -> dict[str, float]:
    """Return steps, wall time and processor time of all threads of a call."""
    wall, processor = time.perf_counter(), time.process_time()
    steps = fly()
    return {
        "steps": steps,
        "wall_s": time.perf_counter() - wall,
        "processor_s": time.process_time() - processor,
    }


def serve(actions: dict[str, Callable[..., dict[str, Any]]], packages: list[str]) -> None:
    """Answer orders {"do": name of an action, its arguments ...} until there are no more."""
    _say({"versions": {package: version(package) for package in packages}})
    for line in sys.stdin:
        arguments = json.loads(line)
        _say(actions[arguments.pop("do")](**arguments))


def _say(answer: dict[str, Any]) -> None:
    sys.stdout.write(f"{MARK}{json.dumps(answer)}\n")
    sys.stdout.flush()
