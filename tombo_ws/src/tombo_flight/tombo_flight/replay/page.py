"""The result of a replay as a page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tombo_flight.replay.metrics import COMPARED, unit_text
from tombo_flight.replay.run import Replay
from tombo_flight.report.page import Page, Section, Table, Text

NamedValue = tuple[str, str]


def replay_page(result: Replay) -> Page:
    """Return the page of a replay: a line for each figure, findings and damage below."""
    rows = [
        (node if i == 0 else "", name, value)
        for node, figures in result.nodes.items()
        for i, (name, value) in enumerate(_rows(node, figures))
    ]
    lines = [
        Text([f"{heading}: {line}" for line in lines], style=colour)
        for heading, colour, lines in (
            ("Damage", "warn", result.damage),
            ("Finding", "warn", result.findings),
            ("Difference", "bad", result.differences),
        )
    ]
    count = len(result.differences)
    speed = f"{result.duration_s:.1f} s recorded"
    if result.seconds > 0.0:
        factor = result.duration_s / result.seconds
        speed += f", replayed in {result.seconds:.2f} s with reading: {factor:.0f} times real time"
    return Page(
        title=f"Replay of {result.bag.name}",
        eyebrow="Replay",
        headline=f"Replay of {result.bag}",
        verdict=f"{count} difference{'s' * (count > 1)}" if count else "no difference",
        verdict_style="bad" if count else "good",
        summary="" if count else "Nothing differs by more than the tolerances.",
        sections=[
            Section("", [Table(("node", "figure", "value"), rows)]),
            Section("", lines),
            Section("", [Text([speed])]),
        ],
        data=result.as_mapping(),
    )


def _rows(node: str, figures: dict[str, Any]) -> Iterator[NamedValue]:
    """Yield the figures of a node: how many poses it got, its series, what else it has."""
    if "poses" in figures:
        yield "poses", _with_refused(str(figures["poses"]), figures.get("poses_refused"))
    if node == "detector":
        yield from _detector(figures)
    for compared in COMPARED.get(node, ()):
        yield compared.name, _difference(figures[compared.key], compared.unit)
    if node == "mission":
        yield "phases", ", ".join(figures["phases_replayed"])
        if figures["phase_time_difference_ms"]:
            yield "phases begin", f"{_list(figures['phase_time_difference_ms'], 0)} ms"
    if node == "reaction":
        counts = "{switches_recorded} recorded, {switches_replayed} replayed"
        yield "switches", counts.format_map(figures)
        if figures["x_r_error_m"]:
            yield "x_r", f"{_list(figures['x_r_error_m'], 6)} m"
            yield "switch time", f"{_list(figures['switch_time_difference_ms'], 1)} ms"
        if figures.get("events_refused"):
            yield "events", _with_refused("", figures["events_refused"])


def _detector(figures: dict[str, Any]) -> Iterator[NamedValue]:
    recorded, replayed = figures["events_recorded"], figures["events_replayed"]
    if recorded is None:
        yield "events", f"{len(replayed)} replayed, none recorded (no topic)"
    else:
        matched = "{matched} matched, {missed} missed, {extra} extra".format_map(figures)
        yield "events", f"{len(recorded)} recorded, {len(replayed)} replayed: {matched}"
    for event in replayed:
        x, y, z = event["x_c_m"]
        yield (
            "  event",
            (
                f"at {event['stamp_s']:.3f} s ({event['trigger']}), known at "
                f"{event['known_s']:.3f} s, statistic {event['statistic']:.0f}, "
                f"x_c {x:.3f} {y:.3f} {z:.3f} m"
            ),
        )
    if recorded:
        yield "detection time", f"{_list(figures['detection_time_difference_ms'], 3)} ms"
        yield "x_c", f"{_list(figures['x_c_error_m'], 6)} m"
    if figures["false_alarms"] is not None:
        yield "false alarms", str(figures["false_alarms"])
    if any(value is not None for value in figures["latency_ms"]):
        yield "true contact to event", f"{_list(figures['latency_ms'], 1)} ms"


def _difference(figures: dict[str, Any] | None, unit: str) -> str:
    if figures is None:
        return "not recorded"
    rms, most = (_number(figures[f"{what}_{unit}"], 6) for what in ("rms", "max"))
    return (
        f"differs by {rms} {unit_text(unit)} RMS, {most} at most ({figures['compared']} compared)"
    ).replace("  ", " ")


def _with_refused(text: str, refused: dict[str, int] | None) -> str:
    counts = ", ".join(f"{count} {why}" for why, count in (refused or {}).items())
    return ", ".join(part for part in (text, f"refused: {counts}" if counts else "") if part)


def _list(values: list[float | None], digits: int) -> str:
    return ", ".join(_number(value, digits) for value in values) or "-"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{round(value, digits):.10g}"
