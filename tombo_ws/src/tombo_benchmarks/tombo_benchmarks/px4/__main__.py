"""Flies with a real PX4 SITL, many seeds, and prints and writes the table of docs/px4.md.

With `--losses` each flight loses something in hover; the table is that of docs/faults.md, and
without a PX4 the simulated one flies.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from tombo_benchmarks.docs.markdown import table_markdown, updated
from tombo_benchmarks.px4.lockstep_flight import fly_lockstep
from tombo_benchmarks.px4.lockstep_px4 import Px4Setup
from tombo_benchmarks.px4.losses import LOSSES, fly_loss, loss_line, loss_table
from tombo_benchmarks.px4.node_flight import fly_nodes_with
from tombo_benchmarks.px4.px4_process import px4_build
from tombo_benchmarks.px4.services import SHOWS, STATES, fly_service
from tombo_benchmarks.px4.wrong_axes import fly_wrong_axes, wrong_axes_flights
from tombo_benchmarks.px4.wrong_axes import table as wrong_axes_table
from tombo_bringup.cli.errors import print_error
from tombo_collision.reactions import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_flight.json_text import as_json
from tombo_flight.process.output_folder import open_output
from tombo_flight.process.stop_signals import StopSignals
from tombo_flight.scenario import Scenario, load_scenario

_SQUARE: Final = "mission.course=[{x: 1.0}, {y: 1.0}, {x: 0.0}, {y: 0.0}]"
_COLLISION: Final = "paper_collision"
FLIGHTS: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "hover": ("hover", ()),
    "square": ("no_obstacle", (_SQUARE,)),
    "figure eight": ("figure_eight", ()),
    "collision": (_COLLISION, ()),
}
"""Name -> scenario and settings."""
_FIGURES: Final = (
    ("estimate_error_mean_m", "PX4's position, mean error", "mm", 1e3, 0),
    ("estimate_error_max_m", "PX4's position, largest error", "mm", 1e3, 0),
    ("hover_rms_m", "hover, RMS from the set point", "mm", 1e3, 0),
    ("approach_rms_m", "on the way, RMS from the set point", "mm", 1e3, 0),
    ("detection_latency_s", "detected after contact", "ms", 1e3, 0),
    ("max_falling_distance_m", "falls", "m", 1.0, 2),
    ("recovery_time_s", "settled at x_r after contact", "s", 1.0, 1),
)
"""Figure of `summary.json`, its name, its unit, factor and digits."""
Row = Mapping[str, Any]
Cases = Iterator[tuple[str, int, Callable[[Px4Setup], Row]]]


@dataclass(frozen=True)
class Study:
    """Flights of a kind, with their lines and table.

    Attributes:
        cases: name and seed of a flight, and what flies it and returns its row.
        line: text about a flight, behind its name.
        table: of all rows.
        good: whether a flight went as it must.
        page: page and marker of the table.
    """

    cases: Cases
    line: Callable[[Row], str]
    table: Callable[[Sequence[Row]], str]
    good: Callable[[Row], bool]
    page: tuple[str, str] | None = None


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly; return 0, 1 if a flight did not go as it must, 2 for bad input."""
    options = _options(arguments)
    if options.px4 is None and not (options.simulated or options.losses):
        print("skipped: no PX4; accepted: make test-px4 PX4=DIR, a PX4 SITL that was built there")
        return 0
    rows: list[Row] = []
    try:
        simulated = options.simulated or options.px4 is None
        build = None if simulated else px4_build(options.px4)
        with TemporaryDirectory() as scratch, StopSignals(signal.SIGHUP) as stop:
            if options.first_flight:
                folder = options.keep or Path(scratch) / "first"
                place = "simulated" if build is None else str(build)
                words = [place, str(folder), str(options.instance), *(options.row or ())]
                command = [sys.executable, "-m", "tombo_benchmarks.px4.first_flight_node", *words]
                command += ["--quick"] * options.quick
                return subprocess.run(command).returncode
            study = _study(options, build is not None, stop)
            for name, seed, fly in study.cases:
                if stop.requested():
                    break
                if not options.row or any(word in name for word in options.row):
                    folder = Path(scratch) / str(len(rows))
                    rows.append(fly(Px4Setup(build, folder, seed, options.instance)))
                    print(f"{name}: {study.line(rows[-1])}", flush=True)
    except InputError as error:
        print_error(str(error))
        return 2
    table = study.table(rows)
    print(f"\n{table}")
    if options.output is not None:
        options.output.write_text(as_json(rows), encoding="utf-8")
    if options.docs and study.page is not None and Path(study.page[0]).is_file():
        page = Path(study.page[0])
        text = updated(page.read_text(encoding="utf-8"), {study.page[1]: f"\n{table}\n"})
        page.write_text(text, encoding="utf-8")
    return int(not all(study.good(row) for row in rows))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make test-px4", description=__doc__)
    parser.add_argument("px4", nargs="?", type=Path, help="source tree or build of PX4 SITL")
    for name, default, text in (
        ("--seeds", 20, "of the collision; default 20"),
        ("--few", 3, "seeds of hover and square; default 3"),
        ("--first", 0, "first seed"),
        ("--nodes", 0, "fly so many collisions over the nodes in real time, and nothing else"),
        ("--instance", 0, "of PX4: its ports and its id"),
    ):
        parser.add_argument(name, type=int, default=default, help=text)
    for name, text in (
        (
            "--losses",
            "lose something in each flight, --few seeds; without PX4 the simulated flies",
        ),
        ("--wrong-axes", "fly with wrong axes of the motion capture, each once"),
        ("--services", "ask for each service in each state"),
        ("--first-flight", "do `tombo first-flight`, without and with each planted fault"),
        ("--simulated", "the simulated PX4 flies, in place of a real one"),
        ("--quick", "with --first-flight: listen and hover for seconds only"),
        ("--docs", "write the table into its page"),
    ):
        parser.add_argument(name, action="store_true", help=text)
    parser.add_argument("--row", action="append", help="only flights with this word in their name")
    parser.add_argument(
        "--reaction", choices=sorted(REGISTRY), help="of the collision, in place of the scenario's"
    )
    parser.add_argument("--output", type=Path, help="write all figures as JSON")
    parser.add_argument(
        "--keep", type=Path, help="with --nodes and --first-flight: folder of the files"
    )
    return parser.parse_args(arguments)


def _study(options: argparse.Namespace, is_real: bool, stop: StopSignals) -> Study:
    """Return the flights that the options ask for."""
    first = options.first
    if options.losses:
        losses = (
            (f"{loss.name} {seed}", seed, partial(fly_loss, loss=loss))
            for loss in LOSSES
            for seed in range(first, first + options.few)
        )
        marker = "px4_losses" if is_real else "px4_losses_simulated"
        page = ("docs/faults.md", marker)
        return Study(losses, loss_line, loss_table, lambda row: row["ended"], page)
    if options.wrong_axes:
        axes = ((name, first, partial(fly_wrong_axes, name=name)) for name in wrong_axes_flights())
        return Study(axes, _axes_line, wrong_axes_table, lambda row: row["as_wanted"])
    if options.services:
        asked = (
            (f"{service} in {state}", first, partial(fly_service, service=service, state=state))
            for state in STATES
            for service in SHOWS
        )
        return Study(asked, _service_line, _service_summary, lambda row: not row["wrong"])
    flights = _flights(options, is_real, stop)
    page = ("docs/px4.md", "px4_flights")
    return Study(
        flights, _line, markdown_table, lambda row: row["armed"] and not row["crashed"], page
    )


def _axes_line(row: Row) -> str:
    state = "as wanted" if row["as_wanted"] else "NOT as wanted"
    figures = f"{row['away_m']:.2f} m away, {row['height_m']:.2f} m high"
    ends = f"{row['aloft_s']:.1f} s aloft, disarmed {row['disarmed']}"
    return f"{state}, armed {row['armed']}, {figures}, {ends}: {row['text']}"


def _service_line(row: Row) -> str:
    wrong, answer = row["wrong"], row["answer"]
    return f"WRONG ({wrong}): {answer}" if wrong else f"right: {answer}"


def _service_summary(rows: Sequence[Row]) -> str:
    return f"{len(rows)} services and states, {sum(bool(row['wrong']) for row in rows)} wrong"


def _flights(options: argparse.Namespace, is_real: bool, stop: StopSignals) -> Cases:
    """Yield name, seed and flight of each hover, square and collision."""

    def fly(setup: Px4Setup, name: str, scenario: Scenario) -> Row:
        began_s = time.monotonic()
        if options.nodes and is_real:
            kept = options.keep or setup.folder.parent / "flights"
            kept = kept / f"{name}-{setup.seed}"
            kept.parent.mkdir(parents=True, exist_ok=True)
            with open_output(kept, replace=False, numbered=True) as output:
                summary = fly_nodes_with(setup, output, scenario, stop)
                output.publish()
        else:
            summary, _ = fly_lockstep(setup, scenario)
        return {"flight": name, **summary, "took_s": time.monotonic() - began_s}

    for name, (scenario, settings) in FLIGHTS.items():
        count = options.seeds if name == "collision" else options.few
        if options.nodes:
            count = options.nodes if name == "collision" else 0
        if options.reaction and name == "collision":
            settings = (*settings, f"reaction.name={options.reaction}")
        for seed in range(options.first, options.first + count):
            flown = load_scenario(scenario, list(settings))
            yield f"{name} {seed}", seed, partial(fly, name=name, scenario=flown)


def _line(row: Row) -> str:
    state = "crashed" if row["crashed"] else "landed" if row.get("landed") else "not landed"
    parts = [state if row["armed"] else f"never armed: {row['why_not']}"]
    for key, name, unit, scale, digits in _FIGURES:
        if row.get(key) is not None:
            parts.append(f"{name} {scale * row[key]:.{digits}f} {unit}")
    parts.append(f"contacts {row.get('contacts', '–')}, missed {row.get('missed', '–')}")
    return ", ".join([*parts, f"{row['took_s']:.0f} s"])


def markdown_table(rows: Sequence[Row]) -> str:
    """Return the table of the flights: median and largest of each figure, by kind of flight."""
    kinds = list(dict.fromkeys(str(row["flight"]) for row in rows))
    flights = [[row for row in rows if row["flight"] == kind] for kind in kinds]

    def cells(key: str, summary: Callable[[list[Any]], str]) -> list[str]:
        """Return a cell for each kind of flight; "–" where no value is measured."""
        known = [[row[key] for row in those if row.get(key) is not None] for those in flights]
        return [summary(values) if values else "–" for values in known]

    table = [["flights", *(str(len(those)) for those in flights)]]
    for key in ("crashed", "landed"):
        table.append([key, *(str(sum(bool(row.get(key)) for row in those)) for those in flights)])
    again = cells("contacts", lambda values: str(sum(value > 1 for value in values)))
    table.append(["hit the pillar again", *again])
    for key, name, unit, scale, digits in _FIGURES:
        figures = cells(key, partial(_median_and_largest, scale, digits))
        table.append([f"{name} [{unit}]", *figures])
    table.append(["steps without an answer", *cells("missed", lambda values: str(sum(values)))])
    return table_markdown(("", *kinds), table)


def _median_and_largest(scale: float, digits: int, values: list[float]) -> str:
    middle = sorted(values)[len(values) // 2]
    return f"{scale * middle:.{digits}f}, at most {scale * max(values):.{digits}f}"


if __name__ == "__main__":
    sys.exit(main())
