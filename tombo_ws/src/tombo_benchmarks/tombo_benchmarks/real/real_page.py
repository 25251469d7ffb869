"""The page of `tombo benchmark real`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from tombo_benchmarks.diagnosis.runner import BenchmarkResult, Row
from tombo_benchmarks.real.real_benchmark import OUTCOMES
from tombo_benchmarks.real.trials import DATA_SETS
from tombo_diagnosis.wording import percent
from tombo_flight.report.page import Cell, Page, Section, Table

_STYLE: Final = {"right": "good", "set": "good", "wrong": "bad"}
_HEADS: Final = ("right", "truth in the set", "wrong", "unknown", "none", "refused")


def real_page(result: BenchmarkResult) -> Page:
    """Return the page of all trials."""
    rows, found = result.cases, result.aggregate
    of, healthy = found["outcomes"], found["healthy"]
    known, sound = sum(of.values()), sum(healthy.values())
    return Page(
        title="real flights",
        eyebrow="real flights of known causes",
        headline=f"Right: {of['right'] + of['set']} of {known}; wrong: {of['wrong']}",
        summary=(
            f"{of['set']} of the right answers are sets of at most three. Nothing was wrong in "
            f"{sound} further trials: {healthy['wrong']} of them are accused."
        ),
        sections=[
            Section("What was done, and how the answers are", [_matrix(found["matrix"])]),
            Section("Stated confidence against right", [_stated(found["stated"])]),
            *(_answers(name, [r for r in rows if r["data_set"] == name]) for name in DATA_SETS),
        ],
        data={"cases": rows, "aggregate": found},
    )


def _matrix(matrix: Mapping[str, Mapping[str, Mapping[str, int]]]) -> Table:
    return Table(
        ("data set", "what was done", *_HEADS),
        [
            (data_set, truth.replace("_", " "), *(str(counts[name]) for name in OUTCOMES))
            for data_set, truths in matrix.items()
            for truth, counts in truths.items()
        ],
        note="Where nothing was done, none is right, and anything else is wrong.",
    )


def _stated(bins: Sequence[Mapping[str, Any]]) -> Table:
    return Table(
        ("stated", "answers", "mean of stated", "right", "95 % interval (Wilson)"),
        [
            (
                f"{percent(b['from'])} to {percent(b['to'])}", str(b["answers"]),
                *(percent(b[key]) if b["answers"] else "–" for key in ("stated", "right")),
                f"{percent(b['low'])} to {percent(b['high'])}" if b["answers"] else "–",
            )
            for b in bins
        ],
        note="Answers are names, sets and none; unknown states no cause. The last row is all.",
    )  # fmt: skip


def _answers(name: str, rows: Sequence[Row]) -> Section:
    table = Table(
        ("what was done", "asked", "what is said", "stated", "outcome"),
        [
            (
                r["done"], r["way"], Cell(_answer_text(r), "muted"),
                "–" if r["confidence"] is None else percent(r["confidence"]),
                Cell(r["outcome"], _STYLE.get(r["outcome"], "warn")),
            )
            for r in rows
        ],
        note=f"Source: {DATA_SETS[name].source}.",
    )  # fmt: skip
    return Section(name, [table] if rows else [])


def _answer_text(row: Row) -> str:
    said = ", ".join(row["said"])
    return f"{row['verdict']}: {said}" if said else str(row["verdict"])
