"""The page of the comparison with other simulators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, Final

from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.peers.peer_process import PEERS
from tombo_benchmarks.peers.peers_benchmark import (
    OURS,
    REPLAYED_TICKS,
    Result,
    as_data,
    from_goal,
    ratios,
)
from tombo_dynamics.time_base import TICK_S
from tombo_flight.report.page import Cell, Page, Section, Table, TableRow, Text

_ALIKE: Final = (
    ("vehicle, drag, gravity, motor lag", "same numbers", "same numbers", "same numbers"),
    ("thrust and torque", "map of the rotor's speed", "square of it", "square of it"),
    ("step", "1 ms", "1 ms", "1 ms"),
    ("integrator", "Runge-Kutta 4, rotors exact", "RK45 of scipy, adaptive", "Runge-Kutta 4"),
    ("numbers", "float64", "float64", "float32"),
    ("controller", "cascade 50, 250, 1000 Hz", "SE(3), 1000 Hz", "Mellinger, 50 and 1000 Hz"),
    ("rotor's spin momentum", "yes", "no", "yes"),
    ("contact", "pillar, ground: looked for", "none", "height held above the floor"),
    ("other effects (wind, strike …)", "computed, at null", "wind, at null", "none"),
    ("batches", "blocks on threads", "need PyTorch: not flown", "one array"),
    ("whole flight", "paper's; in batches to the contact", "the course", "–"),
    ("whole flight: sensors", "IMU 1 kHz, mocap 30 Hz, late", "IMU, mocap 1 kHz", "–"),
    ("whole flight: estimator, detector", "yes, yes", "null estimator, –", "–"),
    ("compiled by", "numba, kept on disk", "–", "JAX, in each process"),
)


def peers_page(result: Result) -> Page:
    """Return the page of a comparison."""
    rounds = max((len(r) for r in result.readings.values()), default=0)
    machine = result.machine
    summary = (
        f"Medians of {rounds} rounds, all in turn (least to most), one process each, on "
        f"{machine['cores']} cores of {machine['processor']}; load {machine['load_before']:.1f} "
        f"before, {machine['load_after']:.1f} after. Steps of 1 ms of one vehicle, per second of "
        "a processor core; compilation is not in it."
    )
    sections = [Section("Steps a second", [_speed(result)])]
    sections.append(Section("The same course", [_agreement(result)]))
    alike = Table(("", "here", "rotorpy", "crazyflow"), _ALIKE)
    sections.append(Section("What is alike, and what is not", [alike]))
    sections.append(Section("Before the first flight", [_before(result)]))
    if result.absent:
        lines = [f"{name}: {reason}" for name, reason in result.absent.items()]
        sections.append(Section("Not measured", [Text(lines, "list", "warn")]))
    return Page(
        title="Other simulators",
        eyebrow="tombo_benchmarks.peers",
        headline="The same course in other simulators",
        summary=summary,
        sections=sections,
        data=as_data(result),
    )


def _speed(result: Result) -> Table:
    rows: list[TableRow | Sequence[str | Cell]] = []
    for case, readings in result.readings.items():
        own = [1e-3 * r.per_processor_s for r in readings]
        wall = median(1e-3 * r.per_wall_s for r in readings)
        over = ratios(result.readings, case)
        rows.append((
            case.group, case.simulator, spread(own), spread(over) if over else "", f"{wall:.4g}",
        ))  # fmt: skip
    head = ("", "simulator", "1000 steps, processor second", "ours over it", "wall second")
    return Table(head, rows)


def spread(values: Sequence[float]) -> str:
    """Return the median and the range of values."""
    middle, least, most = map(_figure, (median(values), min(values), max(values)))
    if len(values) == 1:
        return middle
    return f"{middle} ({least} to {most})"


def _figure(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def peers_markdown(data: Mapping[str, Any]) -> str:
    """Return the tables of a page of the documentation from a page's data."""
    simulators = (OURS, *PEERS)
    groups: dict[str, dict[str, str]] = {}
    for case in data["cases"]:
        steps = median(r["steps_per_processor_s"] for r in case["readings"])
        over = f"; here {spread(case['ratios'])} times" if case["ratios"] else ""
        groups.setdefault(case["group"], {})[case["simulator"]] = f"{_short(steps)}{over}"
    compiled = {
        name: f"{times['compile_s']:.0f} s"
        for name, times in data["before_first_flight"].items()
        if "compile_s" in times
    }
    versions = [f"{name} {parts[name]}" for name, parts in data["versions"].items()]
    rounds = max(len(case["readings"]) for case in data["cases"])
    machine = data["machine"]
    rows = [
        [group, *(cells.get(name, "–") for name in simulators)] for group, cells in groups.items()
    ]
    ends = {k: f"{1e3 * v:.1f} mm" for k, v in data["end_from_goal_m"].items()}
    replay = {k: f"{1e3 * v:.1f} mm" for k, v in data["replay_distance_m"].items()}
    rows.append(["end of the course, from its goal", *(ends.get(n, "–") for n in simulators)])
    words = f"{REPLAYED_TICKS * TICK_S:g} s of the same rotor commands, from here"
    rows.append([words, *(replay.get(n, "–") for n in simulators)])
    rows += [list(row) for row in _ALIKE]
    head = ["steps of 1 ms a second of a core", "here", *PEERS]
    table = table_markdown(head, rows)
    counted = f"Medians of {rounds} rounds in turn (least to most)" if rounds > 1 else "One round"
    made = ", ".join(f"{name}: {text}" for name, text in compiled.items())
    return (
        f"{table}\n{', '.join(versions)}. {counted}, "
        f"{machine['cores']} cores of {machine['processor']}, load "
        f"{machine['load_before']:.0f} to {machine['load_after']:.0f}. "
        f"Compilation, or loading what an earlier run compiled, is not in it: {made or '–'}.\n"
    )


def _short(value: float) -> str:
    return f"{1e-6 * value:.3g} M" if value >= 1e6 else f"{1e-3 * value:.3g} k"


def _agreement(result: Result) -> Table:
    rows = []
    for name, off in from_goal(result).items():
        replayed = result.replayed.get(name)
        shown = "" if replayed is None else f"{1e3 * replayed:.1f}"
        rows.append((name, f"{1e3 * off:.1f}", shown))
    seconds = REPLAYED_TICKS * TICK_S
    head = (
        "simulator",
        "end of the course from the goal [mm], own controller",
        f"from ours after {seconds:g} s of the same rotor commands [mm]",
    )
    return Table(head, rows)


def _before(result: Result) -> Table:
    words = {"made_s": "worlds made", "compile_s": "compiled", "first_flight_s": "first flight"}
    rows = [
        (name, ", ".join(f"{words[key]} {value:.2f} s" for key, value in times.items()))
        for name, times in result.before.items()
    ]
    note = "Here compiled code is kept on disk: a first flight loads it, or compiles it once."
    return Table(("", "wall time"), rows, note=note)
