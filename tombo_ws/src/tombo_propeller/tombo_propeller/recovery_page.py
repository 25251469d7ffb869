"""The collisions in a trace as a page of results, and its files: JSON, picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from tombo_flight.report.page import Page, Picture, Section, Text, page_json
from tombo_flight.report.style import GREEN, MUTED, VERMILLION, figure_bytes, new_figure
from tombo_propeller.recovery import ThrustRecovery
from tombo_propeller.rotor_trace import RotorTrace

RECOVERY_FILES = ("recovery.json", "recovery.png")


def recovery_page(trace: RotorTrace, recoveries: Sequence[ThrustRecovery], share: float) -> Page:
    """Return the result: each collision of a trace with the time until `share` is back."""
    lines = []
    for r in recoveries:
        level = f"{r.level:.0f}" if r.level >= 1000.0 else f"{r.level:.3g}"
        words = r.as_text(lower_bound=trace.is_speed)
        lines.append(f"Collision at {r.time:.3f} s, from {level}: recovered after {words}")
    times = [r.recovered for r in recoveries if not r.why]
    if len(times) > 1:
        least = "at least " if trace.is_speed else ""
        lines.append(f"Mean of {len(times)}: {least}{sum(times) / len(times):.3f} s")
    notes = [f"{note}." for note in trace.notes]
    if trace.is_speed:
        notes.insert(
            0,
            "a lower bound, as it is a speed: while a blade is folded, thrust is less than its "
            "speed says.",
        )
    drawing = Picture(lambda: draw_recovery(trace, recoveries, share), "The trace")
    return Page(
        title="Recovery",
        eyebrow="Tombo propeller, recovery from a trace",
        headline=_headline(recoveries),
        summary=f"{trace.column}: recovered at {share:.1%} of the level before",
        sections=[
            Section("Collisions", [Text(lines), drawing]),
            Section("Notes", [Text(notes, "list")] if notes else []),
        ],
        data={
            "trace": trace.column,
            "lower_bound": trace.is_speed,
            "recovered_at_share": share,
            "collisions": [_collision(trace, r) for r in recoveries],
        },
    )


def write_recovery(
    folder: Path, trace: RotorTrace, recoveries: Sequence[ThrustRecovery], page: Page
) -> None:
    """Write all files of a result into a folder that exists."""
    (folder / "recovery.json").write_text(page_json(page), encoding="utf-8")
    drawn = draw_recovery(trace, recoveries, page.data["recovered_at_share"])
    (folder / "recovery.png").write_bytes(figure_bytes(drawn))


def _headline(recoveries: Sequence[ThrustRecovery]) -> str:
    plural = "s" if len(recoveries) > 1 else ""
    complete = sum(not r.why for r in recoveries)
    return f"{len(recoveries)} collision{plural}, {complete} with a recovery"


def _collision(trace: RotorTrace, r: ThrustRecovery) -> dict[str, Any]:
    return {
        "time_s": r.time,
        "level": r.level,
        "lowest": r.lowest,
        "recovery_s": r.recovered,
        "low_s": r.low,
        "high_s": r.high,
        "words": r.as_text(lower_bound=trace.is_speed),
    }


def draw_recovery(trace: RotorTrace, recoveries: Sequence[ThrustRecovery], share: float) -> Figure:
    """Draw the trace, and for each collision the time until `share` of its level is back."""
    with new_figure(8.0, 3.8, 100, layout="constrained") as figure:
        axes: Any = figure.subplots()
        axes.plot(trace.time, trace.value, color=MUTED, lw=0.7)
        for k, r in enumerate(recoveries):
            axes.axvline(r.time, color=VERMILLION, lw=1.0, label=None if k else "collision")
            end = r.time + (r.recovered if math.isfinite(r.recovered) else r.low)
            axes.plot([r.time, end], [share * r.level] * 2, color=GREEN, lw=1.4,
                      label=None if k else f"until {share:.0%} of the level before")  # fmt: skip
            if math.isfinite(r.high):
                axes.axvspan(r.time + r.low, r.time + r.high, color=GREEN, alpha=0.3, lw=0)
            least = "≥ " if trace.is_speed else ""
            shown = f"{least}{r.recovered:.2f} s" if not r.why else f"> {r.low:.2f} s"
            axes.annotate(shown, (0.5 * (r.time + end), share * r.level), xytext=(0, 4),
                          textcoords="offset points", ha="center", color=GREEN)  # fmt: skip
        figure.suptitle(_headline(recoveries), fontsize=10.5)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(trace.column)
        axes.legend(loc="lower right")
    return figure
