"""Tables and lines of the commands of `tombo benchmark`: figures and their wanted bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from tombo_benchmarks.diagnosis.runner import BenchmarkResult
from tombo_flight.report.page import Cell, Table


class Figure(NamedTuple):
    """A figure of a score: its key, its label, and the wanted bounds."""

    key: str
    label: str
    least: float = -math.inf
    most: float = math.inf
    is_share: bool = True

    def meets(self, value: float) -> bool:
        """Return whether a value is within the wanted bounds."""
        return self.least <= value <= self.most

    def wanted(self) -> str:
        """Return the wanted bounds; empty: there are none."""
        low, high = math.isfinite(self.least), math.isfinite(self.most)
        if low and high:
            return f"{self.text(self.least)} to {self.text(self.most)}"
        return f">= {self.text(self.least)}" if low else f"<= {self.text(self.most)}" * high

    def text(self, value: float) -> str:
        """Return a value as it is printed."""
        return f"{100.0 * value:.1f} %" if self.is_share else f"{value:.2f}"


FLIGHTS: Final = (
    Figure("top1_large", "right cause first, large effect", least=0.97),
    Figure("top1_medium", "right cause first, medium effect", least=0.85),
    Figure("top1_small", "right cause first, small effect", least=0.65),
    Figure("another_named", "another cause named than the one that is there", most=0.05),
    Figure("right_if_named", "right if named", least=0.98),
    Figure("truth_in_set", "truth in the answered set", least=0.99),
    Figure("mean_set_size", "mean size of the set", most=2.0, is_share=False),
    Figure("false_alarm", "false alarm without an effect", most=0.05),
    Figure("unknown_wrongly_named", "unknown cause wrongly named", most=0.02),
    Figure("parameter_error_median", "parameter error, median", most=0.02),
    Figure("parameter_error_p90", "parameter error, 90 % below", most=0.10),
    Figure("coverage_95", "95 % intervals that cover the truth", least=0.90, most=0.98),
    Figure("seconds_per_case", "run time of a case [s]", most=5.0, is_share=False),
)
STANDS: Final = (
    Figure("top1_large", "right cause first, large", least=0.95),
    Figure("top1_medium", "... medium"),
    Figure("top1_small", "... small"),
    Figure("answer_large", "... or in a set of six at most, large"),
    Figure("answer_medium", "... medium"),
    Figure("answer_small", "... small"),
    Figure("right_if_named", "right if named"),
    Figure("truth_in_set", "truth in the answered set"),
    Figure("mean_set_size", "mean size of the set", is_share=False),
    Figure("false_alarm", "false alarm without an effect", most=0.05),
    Figure("false_alarm_upper", "... upper bound, 95 %"),
    Figure("unknown_wrongly_named", "unknown cause wrongly named", most=0.02),
    Figure("unknown_partly_explained", "... called partly explained"),
    Figure("unknown_missed", "... missed"),
    Figure("pair_both", "two causes: both"),
    Figure("pair_one", "... at least one"),
    Figure("parameter_error_median", "parameter error, median"),
    Figure("parameter_error_p90", "... 90 % below"),
    Figure("coverage_95", "95 % intervals that cover"),
    Figure("seconds_per_case", "seconds a case", is_share=False),
)


def score_table(figures: Sequence[Figure], result: BenchmarkResult) -> Table:
    """Return figures of all cases and of each part that is scored on its own, as columns."""
    found = result.aggregate
    parts = {"all": found} | {
        name.replace("_", " "): part
        for name, part in found.items()
        if isinstance(part, Mapping) and "top1_large" in part
    }
    rows: list[Sequence[str | Cell]] = []
    if all("cases" in part for part in parts.values()):
        rows.append(("cases", "", *(str(part["cases"]) for part in parts.values())))
    for figure in figures:
        values = [part.get(figure.key) for part in parts.values()]
        cells = [
            Cell("–")
            if value is None or value != value
            else Cell(figure.text(value), "" if figure.meets(value) else "bad")
            for value in values
        ]
        rows.append((figure.label, figure.wanted(), *cells))
    return Table(("", "asked for", *parts), rows, title=f"{len(result.cases)} blind cases")


def crash_table(result: BenchmarkResult) -> Table:
    """Return the score of all crashes and of each kind."""
    rows = [
        (
            kind.replace("_", " "),
            str(part["cases"]),
            *(f"{100 * part[key]:.0f} %" for key in ("right", "in_time")),
            *(str(part[key]) for key in ("wrong", "abstained")),
        )
        for kind, part in [("all", result.aggregate), *result.aggregate["kinds"].items()]
        if part["cases"]
    ]
    head = ("", "cases", "right", "within 0.1 s", "wrong", "abstained")
    return Table(head, rows, title=f"{len(result.cases)} simulated crashes")


def fault_lines(result: BenchmarkResult) -> list[str]:
    """Return the lines about sequences of faults, and about nodes that fail in flight."""
    found = result.aggregate
    lines = [
        f"{found['enumerated']} single faults and pairs in every phase, "
        f"{found['random']} random sequences: {found['violations']} with a violation",
        *(f"  {kind}: {number}" for kind, number in found["by_kind"].items()),
        f"Rotors on at the ground in a descent: at most {found['longest_ground_s']:.1f} s",
        f"Transitions taken: {found['rows_used']}; not: "
        f"{', '.join(found['rows_unused']) or 'none'}",
    ]
    return [*lines, *map(_behind, found.get("nodes", []))]


def _behind(row: Mapping[str, Any]) -> str:
    """Return the line about a flight after a fault of a node."""
    text = f"{row['fault']}: {row['ends']}, drift {row['drift_m']:.2f} m"
    if row["down_s"] is not None:
        off = row["rotors_off_s"]
        text += (
            f", sinks at {row['sink_m_s']:.2f} m/s, down after {row['down_s']:.1f} s, rotors off "
            f"{'never' if off is None else f'{off:.1f} s later'}, slides {row['slid_m']:.2f} m"
        )
    return text + (", FLIES AGAIN" if row["flew_again"] else "")
