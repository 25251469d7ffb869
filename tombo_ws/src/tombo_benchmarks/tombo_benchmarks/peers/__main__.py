"""Fly a Crazyflie over one course here and with crazyflow, and compare speed and positions.

    python -m tombo_benchmarks.peers PYTHON [--rounds 5]

PYTHON is that of an environment with crazyflow: `python -m venv FOLDER`, then
`FOLDER/bin/pip install crazyflow==0.4.0 jax==0.10.1 jaxlib==0.10.1` (1.6 GB).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import typer

from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.peers.course import (
    CORNERS,
    SECONDS,
    OurVehicles,
    course_scenario,
    order,
    starts,
)
from tombo_bringup.cli.errors import exit_code_of
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import TICK_S

CASES: Final = {"1": 12000, "64": 6000, "4096": 1000}
"""Number of vehicles -> ticks of the course that they fly."""
_SCRIPT: Final = Path(__file__).parents[2] / "other_environments" / "crazyflow_course.py"


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(prog="python -m tombo_benchmarks.peers")
    parser.add_argument("python", type=Path, help="of an environment with crazyflow")
    parser.add_argument("--rounds", type=int, default=5, help="of all cases (default: 5)")
    options = parser.parse_args()
    if not 1 <= options.rounds <= 1000:
        raise InputError(f"--rounds {options.rounds}: out of bounds; accepted: 1 to 1000")
    sent = order(course_scenario()) | {
        "rounds": options.rounds, "cases": CASES, "starts": starts(4096).tolist(),
    }  # fmt: skip
    answer = fly_crazyflow(options.python.absolute(), sent)
    ours: dict[str, Any] = {"rates": {}}
    for count, ticks in CASES.items():
        vehicles = OurVehicles(int(count), ticks)
        vehicles.fly()  # compiles
        ours["rates"][count] = [vehicles.fly() for _ in range(options.rounds)]
        if ticks == round(SECONDS / TICK_S):
            ours["end"] = vehicles.position[0]
    typer.echo(comparison(ours, answer), nl=False)


def fly_crazyflow(python: Path, sent: Mapping[str, Any]) -> dict[str, Any]:
    """Return what `crazyflow_course.py` answers: rates, end, versions.

    Raises:
        InputError: it fails.
    """
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    with TemporaryDirectory(prefix="tombo-") as folder:
        asked, answer = Path(folder) / "order.json", Path(folder) / "answer.json"
        asked.write_text(json.dumps(sent))
        command = [python, _SCRIPT, asked, answer]
        environment |= {"JAX_PLATFORMS": "cpu"}
        done = subprocess.run(
            command, capture_output=True, text=True, env=environment, cwd=folder, check=False
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise InputError(f"'{python}': {last}; accepted: a Python that has crazyflow")
        result: dict[str, Any] = json.loads(answer.read_text())
        return result


def comparison(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> str:
    """Return the table: steps in a second of a core, and how far the course's end is missed.

    Both have `rates`, number of vehicles → a number a round, and `end`, map [m].
    """
    rows: list[Sequence[str]] = []
    for count, rates in ours["rates"].items():
        here, there = median(rates), median(theirs["rates"][count])
        row = (f"steps of {count} vehicles", _short(here), _short(there), f"{here / there:.3g}")
        rows.append(row)
    apart = [np.linalg.norm(np.array(one["end"]) - CORNERS[-1]) for one in (ours, theirs)]
    rows.append(("end of the course, from its goal", *(f"{1e3 * d:.1f} mm" for d in apart), ""))
    table = table_markdown(("a second of a core, steps of 1 ms", "here", "crazyflow", "×"), rows)
    versions = ", ".join(f"{name} {number}" for name, number in theirs["versions"].items())
    return (
        f"{table}\n{versions}; medians of {len(rates)} rounds, {len(os.sched_getaffinity(0))} "
        "cores, without compilation.\n"
    )


def _short(value: float) -> str:
    return f"{1e-6 * value:.3g} M"


if __name__ == "__main__":
    sys.exit(exit_code_of(main))
