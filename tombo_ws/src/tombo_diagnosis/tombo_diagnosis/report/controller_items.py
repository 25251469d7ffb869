"""The items of a report about the controller."""

from __future__ import annotations

from tombo_diagnosis.control.controller import ControllerReport
from tombo_flight.report.page import Item, Table, Text


def controller_items(report: ControllerReport | None) -> list[Item]:
    """Return gains with intervals, oscillations, and the unknown gains."""
    if report is None:
        return []
    items: list[Item] = []
    lines = [report.summary] if report.summary else []
    if report.compared_with and not report.changed:
        lines.append(f"By its gains the controller is the same as {report.compared_with}.")
    if lines:
        items.append(Text(lines, "list"))
    expected = {c.gain.label: f"{c.expected.value:.3g}" for c in report.changed}
    rows = [
        [g.loop, g.axis, g.term, f"{g.value:.3g}", f"{g.low:.3g} to {g.high:.3g}", g.unit,
         expected.get(g.label, "")]
        for g in report.gains
    ]  # fmt: skip
    if rows:
        head = ("loop", "axis", "gain", "value", "95 % interval", "unit", "expected")
        items.append(Table(head, rows))
    if report.unknown:
        items.append(Text([f"Not known: {'; '.join(report.unknown)}."], "list"))
    return items
