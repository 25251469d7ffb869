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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, TypeVar

from tombo_benchmarks.docs.markdown import table_markdown, updated
from tombo_benchmarks.px4.lockstep_flight import fly_lockstep
from tombo_benchmarks.px4.losses import LOSSES, Loss, LossResult, fly_loss
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
    "collision": (_COLLISION, ()),
}
"""Name -> scenario and settings."""
_TABLE: Final = "px4_flights"
_PAGE: Final = Path("docs/px4.md")
_LOSS_TABLE: Final = "px4_losses"
_LOSS_PAGE: Final = Path("docs/faults.md")
_MM: Final = 1e3


@dataclass(frozen=True)
class Figure:
    """A row of the table: a figure of `summary.json`, its name and its unit."""

    key: str
    name: str
    unit: str
    scale: float = 1.0
    digits: int = 0


_FIGURES: Final = (
    Figure("estimate_error_mean_m", "PX4's position, mean error", "mm", _MM),
    Figure("estimate_error_max_m", "PX4's position, largest error", "mm", _MM),
    Figure("hover_rms_m", "hover, RMS from the set point", "mm", _MM),
    Figure("approach_rms_m", "on the way, RMS from the set point", "mm", _MM),
    Figure("detection_latency_s", "detected after contact", "ms", 1e3),
    Figure("max_falling_distance_m", "falls", "m", 1.0, 2),
    Figure("recovery_time_s", "settled at x_r after contact", "s", 1.0, 1),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly; return 0, 1 if a flight crashed or never began, 2 for bad input."""
    options = _options(arguments)
    if options.losses:
        return _fly_losses(options)
    if options.px4 is None and not options.simulated:
        print("skipped: no PX4; accepted: make test-px4 PX4=DIR, a PX4 SITL that was built there")
        return 0
    try:
        build = None if options.simulated else px4_build(options.px4)
        with TemporaryDirectory() as scratch, StopSignals(signal.SIGHUP) as stop:
            if options.first_flight and build is not None:
                folder = options.keep or Path(scratch) / "first"
                words = [str(build), str(folder), str(options.instance)]
                command = [sys.executable, "-m", "tombo_benchmarks.px4.driver_node", *words]
                return subprocess.run(command).returncode
            if options.services:
                return _fly_services(build, Path(scratch), options, stop)
            if options.wrong_axes:
                return _fly_wrong_axes(build, Path(scratch), options, stop)
            found = list(_fly_all(build, Path(scratch), options, stop))
    except InputError as error:
        print_error(str(error))
        return 2
    table = markdown_table(found)
    print(f"\n{table}")
    _write_rows(options, found)
    if options.docs and _PAGE.is_file():
        page = _PAGE.read_text(encoding="utf-8")
        _PAGE.write_text(updated(page, {_TABLE: f"\n{table}\n"}), encoding="utf-8")
    return int(any(one["crashed"] or not one["armed"] for one in found))


def _fly_losses(options: argparse.Namespace) -> int:
    """Fly the losses; return 1 if one did not end on the ground, disarmed."""
    seeds = range(options.first, options.first + options.few)
    try:
        build = None if options.px4 is None else px4_build(options.px4)

        def fly(loss: Loss, seed: int, folder: Path) -> LossResult:
            return fly_loss(loss, seed, build, folder, instance=options.instance)

        named = [(loss.name, partial(fly, loss, seed)) for loss in LOSSES for seed in seeds]
        with TemporaryDirectory() as scratch, StopSignals(signal.SIGHUP) as stop:
            results = _fly_rows(named, Path(scratch), options, stop, _loss_line)
    except InputError as error:
        print_error(str(error))
        return 2
    table = loss_table(results)
    print(f"\n{table}")
    _write_rows(options, [asdict(result) for result in results])
    if options.docs and _LOSS_PAGE.is_file():
        name = _LOSS_TABLE if build is not None else f"{_LOSS_TABLE}_simulated"
        page = _LOSS_PAGE.read_text(encoding="utf-8")
        _LOSS_PAGE.write_text(updated(page, {name: f"\n{table}\n"}), encoding="utf-8")
    return int(not all(result.ended for result in results))


def _loss_line(name: str, result: LossResult) -> str:
    """Return a line about a flight that has lost something."""
    if not result.armed:
        return f"{name} {result.seed}: never armed: {result.why_not}"
    modes = ", ".join(f"{at:.1f} s {name}" for at, name in result.modes)
    state = "down, disarmed, stays so" if result.ended else "NOT ENDED"
    return f"{name} {result.seed}: {state}; {modes}"


def loss_table(results: Sequence[LossResult]) -> str:
    """Return the table of the losses: of several flights the worst figure."""
    head = ("loss", "PX4's modes", "down [s]", "disarmed [s]", "drift [m]", "flies again")
    rows = []
    for loss in dict.fromkeys(result.loss for result in results):
        flights = [result for result in results if result.loss == loss]
        orders = dict.fromkeys(" → ".join(name for _, name in f.modes) for f in flights)
        again = sum(f.again or not f.armed for f in flights)
        rows.append(
            [
                loss,
                "; or ".join(orders),
                _worst([f.down_s for f in flights]),
                _worst([f.off_s for f in flights]),
                f"{max(f.drift_m for f in flights):.2f}",
                f"{again} of {len(flights)}",
            ]
        )
    return table_markdown(head, rows)


def _worst(times_s: Sequence[float | None]) -> str:
    known = [at for at in times_s if at is not None]
    return "never" if len(known) < len(times_s) else f"{max(known):.1f}"


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make test-px4", description=__doc__)
    parser.add_argument("px4", nargs="?", type=Path, help="source tree or build of PX4 SITL")
    parser.add_argument("--seeds", type=int, default=20, help="of the collision; default 20")
    parser.add_argument("--few", type=int, default=3, help="seeds of hover and square; default 3")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument(
        "--nodes", type=int, default=0,
        help="fly so many collisions over the ROS 2 nodes, in real time, and nothing else",
    )  # fmt: skip
    parser.add_argument(
        "--losses", action="store_true",
        help="lose something in each flight, --few seeds; without PX4 the simulated one flies",
    )  # fmt: skip
    parser.add_argument(
        "--wrong-axes", action="store_true",
        help="fly with wrong axes of the motion capture, each once, and nothing else",
    )  # fmt: skip
    parser.add_argument(
        "--services", action="store_true",
        help="ask for each service in each state, and nothing else",
    )  # fmt: skip
    parser.add_argument(
        "--first-flight", action="store_true",
        help="do steps 3 to 6 of docs/first_real_flight.md over the nodes, and nothing else",
    )  # fmt: skip
    parser.add_argument(
        "--row", action="append",
        help="with --losses, --services and --wrong-axes: only rows with this word",
    )  # fmt: skip
    parser.add_argument(
        "--reaction", choices=sorted(REGISTRY), help="of the collision, in place of the scenario's"
    )
    parser.add_argument(
        "--simulated", action="store_true", help="the simulated PX4 flies, in place of a real one"
    )
    parser.add_argument("--instance", type=int, default=0, help="of PX4: its ports and its id")
    parser.add_argument("--output", type=Path, help="write all figures as JSON")
    parser.add_argument(
        "--keep", type=Path, help="with --nodes and --first-flight: folder of the files"
    )
    parser.add_argument("--docs", action="store_true", help="write the table of docs/px4.md")
    options = parser.parse_args(arguments)
    return options


def _plan(options: argparse.Namespace) -> Iterable[tuple[str, Scenario, int]]:
    """Return name, scenario and seed of each flight."""
    for name, (scenario, settings) in FLIGHTS.items():
        count = options.seeds if name == "collision" else options.few
        if options.nodes:
            count = options.nodes if name == "collision" else 0
        if options.reaction and name == "collision":
            settings = (*settings, f"reaction.name={options.reaction}")
        for seed in range(options.first, options.first + count):
            yield name, load_scenario(scenario, list(settings)), seed


Row = TypeVar("Row")


def _fly_rows(
    named: Iterable[tuple[str, Callable[[Path], Row]]],
    scratch: Path,
    options: argparse.Namespace,
    stop: StopSignals,
    line: Callable[[str, Row], str],
) -> list[Row]:
    """Fly the rows that --row leaves, each in a folder of its own, and print a line about each."""
    rows: list[Row] = []
    for name, fly in named:
        if stop.asked():
            break
        if options.row and not any(word in name for word in options.row):
            continue
        rows.append(fly(scratch / str(len(rows))))
        print(line(name, rows[-1]), flush=True)
    return rows


def _write_rows(options: argparse.Namespace, rows: Sequence[Mapping[str, Any]]) -> None:
    if options.output is not None:
        options.output.write_text(as_json(rows), encoding="utf-8")


def _fly_wrong_axes(
    build: Path | None, scratch: Path, options: argparse.Namespace, stop: StopSignals
) -> int:
    """Fly with each wrong set-up; print the table; return the exit code."""

    def fly(name: str, folder: Path) -> dict[str, Any]:
        return fly_wrong_axes(build, folder, name, options.first, instance=options.instance)

    def line(name: str, row: Mapping[str, Any]) -> str:
        state = "as wanted" if row["as_wanted"] else "NOT as wanted"
        figures = f"{row['away_m']:.2f} m away, {row['height_m']:.2f} m high"
        ends = f"{row['aloft_s']:.1f} s aloft, disarmed {row['disarmed']}"
        return f"{name}: {state}, armed {row['armed']}, {figures}, {ends}: {row['text']}"

    named = [(name, partial(fly, name)) for name in wrong_axes_flights()]
    rows = _fly_rows(named, scratch, options, stop, line)
    print(f"\n{wrong_axes_table(rows)}")
    _write_rows(options, rows)
    return int(not all(row["as_wanted"] for row in rows))


def _fly_services(
    build: Path | None, scratch: Path, options: argparse.Namespace, stop: StopSignals
) -> int:
    """Ask for each service in each state; return 1 if an answer or a flight was wrong."""

    def fly(service: str, state: str, folder: Path) -> dict[str, Any]:
        return fly_service(build, folder, service, state, options.first, instance=options.instance)

    def line(name: str, row: Mapping[str, Any]) -> str:
        verdict = f"WRONG ({row['wrong']})" if row["wrong"] else "right"
        return f"{name}: {verdict}: {row['answer']}"

    named = [
        (f"{service} in {state}", partial(fly, service, state))
        for state in STATES
        for service in SHOWS
    ]
    rows = _fly_rows(named, scratch, options, stop, line)
    wrong = sum(bool(row["wrong"]) for row in rows)
    print(f"\n{len(rows)} services and states, {wrong} wrong")
    _write_rows(options, rows)
    return int(wrong > 0)


def _fly_all(
    build: Path | None, scratch: Path, options: argparse.Namespace, stop: StopSignals
) -> Iterable[dict[str, Any]]:
    for number, (name, scenario, seed) in enumerate(_plan(options)):
        if stop.asked():
            return
        began = time.monotonic()
        folder = scratch / str(number)
        if options.nodes and build is not None:
            kept = (options.keep or scratch / "flights") / f"{name}-{seed}"
            kept.parent.mkdir(parents=True, exist_ok=True)
            with open_output(kept, replace=False, numbered=True) as output:
                summary = fly_nodes_with(
                    build, folder, output, scenario, seed, stop, instance=options.instance
                )
                output.publish()
        else:
            summary = fly_lockstep(
                build, folder, scenario, seed, instance=options.instance
            ).summary
        summary = {"flight": name, **summary}
        print(_line(summary, seed, time.monotonic() - began), flush=True)
        yield summary


def _line(summary: Mapping[str, Any], seed: int, wall_s: float) -> str:
    """Return a line about a flight."""
    state = (
        "crashed" if summary["crashed"] else "landed" if summary.get("landed") else "not landed"
    )
    if not summary["armed"]:
        state = f"never armed: {summary['why_not']}"
    parts = [f"{summary['flight']} {seed}: {state}"]
    for figure in _FIGURES:
        value = summary.get(figure.key)
        if value is not None:
            parts.append(f"{figure.name} {figure.scale * value:.{figure.digits}f} {figure.unit}")
    parts.append(f"contacts {summary.get('contacts', '–')}, missed {summary.get('missed', '–')}")
    return ", ".join([*parts, f"{wall_s:.0f} s"])


def markdown_table(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of the flights: median and largest of each figure, by kind of flight."""
    kinds = list(dict.fromkeys(str(one["flight"]) for one in found))
    by = {kind: [one for one in found if one["flight"] == kind] for kind in kinds}
    rows = [["flights", *(str(len(by[kind])) for kind in kinds)]]
    for key, name in (("crashed", "crashed"), ("landed", "landed")):
        counts = (sum(bool(one.get(key)) for one in by[kind]) for kind in kinds)
        rows.append([name, *map(str, counts)])
    rows.append(["hit the pillar again", *(_count(by[kind], "contacts", 1) for kind in kinds)])
    for figure in _FIGURES:
        label = f"{figure.name} [{figure.unit}]"
        rows.append([label, *(_median_and_largest(by[kind], figure) for kind in kinds)])
    rows.append(["steps without an answer", *(_sum(by[kind], "missed") for kind in kinds)])
    return table_markdown(("", *kinds), rows)


def _count(flights: Sequence[Mapping[str, Any]], key: str, more_than: int) -> str:
    """Return in how many flights a figure is larger; "–" where none has measured it."""
    values = [flight[key] for flight in flights if flight.get(key) is not None]
    return str(sum(value > more_than for value in values)) if values else "–"


def _sum(flights: Sequence[Mapping[str, Any]], key: str) -> str:
    values = [flight[key] for flight in flights if flight.get(key) is not None]
    return str(sum(values)) if values else "–"


def _median_and_largest(flights: Sequence[Mapping[str, Any]], figure: Figure) -> str:
    values = sorted(
        figure.scale * one[figure.key] for one in flights if one.get(figure.key) is not None
    )
    if not values:
        return "–"
    middle, most = values[len(values) // 2], values[-1]
    return f"{middle:.{figure.digits}f}, at most {most:.{figure.digits}f}"


if __name__ == "__main__":
    sys.exit(main())
