"""The result of a replay as a page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tombo_flight.replay.run import Replay
from tombo_flight.report.page import Page, Section, Table, Text

NamedValue = tuple[str, str]


def replay_page(result: Replay) -> Page:
    """Return the page of a replay: a line for each figure, findings and damage below."""
    rows = [
        (node if i == 0 else "", name, value)
        for node, figures in result.nodes.items()
        for i, (name, value) in enumerate(_FIGURES[node](figures))
    ]
    lines = [
        Text([f"{heading}: {line}" for line in found], style=colour)
        for heading, colour, found in (
            ("Damage", "warn", result.damage),
            ("Finding", "warn", result.findings),
            ("Difference", "bad", result.differences),
        )
    ]
    same = "Nothing differs by more than the tolerances."
    return Page(
        title=f"Replay of {result.bag.name}",
        eyebrow="Replay",
        headline=f"Replay of {result.bag}",
        verdict=_verdict(result),
        verdict_style="bad" if result.differences else "good",
        summary="" if result.differences else same,
        sections=[
            Section("", [Table(("node", "figure", "value"), rows)]),
            Section("", lines),
            Section("", [Text([_speed(result)])]),
        ],
        data=result.as_mapping(),
    )


def _verdict(result: Replay) -> str:
    count = len(result.differences)
    return "no difference" if not count else f"{count} difference{'s' * (count > 1)}"


def _speed(result: Replay) -> str:
    if result.seconds <= 0.0:
        return f"{result.duration_s:.1f} s recorded"
    factor = result.duration_s / result.seconds
    return (
        f"{result.duration_s:.1f} s recorded, replayed in {result.seconds:.2f} s with reading: "
        f"{factor:.0f} times real time"
    )


def _detector(figures: dict[str, Any]) -> Iterator[NamedValue]:
    yield "poses", _poses(figures)
    recorded, replayed = figures["events_recorded"], figures["events_replayed"]
    if recorded is None:
        yield "events", f"{len(replayed)} replayed, none recorded (no topic)"
    else:
        matched = "{matched} matched, {missed} missed, {extra} extra".format_map(figures)
        yield "events", f"{len(recorded)} recorded, {len(replayed)} replayed: {matched}"
    for event in replayed:
        yield "  event", _event(event)
    if recorded:
        yield "detection time", f"{_list(figures['detection_time_difference_ms'], 3)} ms"
        yield "x_c", f"{_list(figures['x_c_error_m'], 6)} m"
    if figures["false_alarms"] is not None:
        rate = _number(figures["false_alarms_per_minute"], 2)
        yield "false alarms", f"{figures['false_alarms']} ({rate} a minute)"
    if any(value is not None for value in figures["latency_ms"]):
        yield "true contact to event", f"{_list(figures['latency_ms'], 1)} ms"
    if "statistic" in figures:
        yield "statistic", _rms(figures["statistic"], "statistic", "")
    if "filterpy" in figures:
        compared, differing = figures["filterpy"]["compared"], figures["filterpy"]["differing"]
        yield "  by filterpy", f"{compared - differing} of {compared} the same"


def _event(event: dict[str, Any]) -> str:
    x, y, z = event["x_c_m"]
    return (
        f"at {event['stamp_s']:.3f} s ({event['trigger']}), known at {event['known_s']:.3f} s, "
        f"statistic {event['statistic']:.0f}, x_c {x:.3f} {y:.3f} {z:.3f} m"
    )


def _reaction(figures: dict[str, Any]) -> Iterator[NamedValue]:
    yield "set point", _rms(figures["setpoint"], "m", "m")
    counts = (figures[f"switches_{side}"] for side in ("recorded", "replayed"))
    yield "switches", "{} recorded, {} replayed".format(*counts)
    if figures["x_r_error_m"]:
        yield "x_r", f"{_list(figures['x_r_error_m'], 6)} m"
        yield "switch time", f"{_list(figures['switch_time_difference_ms'], 1)} ms"
    if figures.get("events_refused"):
        yield "events refused", _counts(figures["events_refused"])


def _mission(figures: dict[str, Any]) -> Iterator[NamedValue]:
    yield "set point", _rms(figures["setpoint"], "m", "m")
    yield "phases", ", ".join(figures["phases_replayed"])
    if figures["phase_time_difference_ms"]:
        yield "phases begin", f"{_list(figures['phase_time_difference_ms'], 0)} ms"


def _estimator(figures: dict[str, Any]) -> Iterator[NamedValue]:
    yield "poses", _poses(figures)
    yield "position", _rms(figures["position"], "m", "m")
    yield "velocity", _rms(figures["velocity"], "m_s", "m/s")
    yield "attitude", _rms(figures["attitude"], "rad", "rad")


def _controller(figures: dict[str, Any]) -> Iterator[NamedValue]:
    yield "rotor command", _rms(figures["rotor_command"], "rad_s", "rad/s")


def _rms(figures: dict[str, Any] | None, key: str, unit: str) -> str:
    if figures is None:
        return "not recorded"
    rms, most = figures[f"rms_{key}"], figures[f"max_{key}"]
    return (
        f"differs by {_number(rms, 6)} {unit} RMS, {_number(most, 6)} at most "
        f"({figures['compared']} compared)"
    ).replace("  ", " ")


def _poses(figures: dict[str, Any]) -> str:
    refused = figures.get("poses_refused")
    text = _counts(refused) if isinstance(refused, dict) else str(refused or "")
    return f"{figures.get('poses', '?')}" + (f", refused: {text}" if text else "")


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {why}" for why, count in counts.items())


def _list(values: list[float | None], digits: int) -> str:
    return ", ".join(_number(value, digits) for value in values) or "-"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{round(value, digits):.10g}"


_FIGURES = {
    "detector": _detector,
    "reaction": _reaction,
    "mission": _mission,
    "estimator": _estimator,
    "controller": _controller,
}
