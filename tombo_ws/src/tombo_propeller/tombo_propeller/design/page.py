"""A design as a page of results, and its files: JSON, page, pictures, what `tombo fly` takes."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any, Final

from tombo_dynamics.propeller import RPM
from tombo_flight.json_text import plain
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.report.page import (
    Card,
    Cell,
    Item,
    Page,
    Picture,
    Section,
    Table,
    TableRow,
    Text,
    page_json,
    write_page,
)
from tombo_flight.report.style import figure_bytes
from tombo_flight.version import tombo_version
from tombo_propeller.design import summary_text as words
from tombo_propeller.design.candidates import PROPERTIES, describe
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Check, Recommendation, strike_of
from tombo_propeller.design.flight_files import (
    LIBRARY,
    LIBRARY_FILES,
    SCENARIO,
    scenario_of,
    write_flyable,
)
from tombo_propeller.design.plots import draw_candidates
from tombo_propeller.design.request import QUANTITIES

JSON: Final = "design.json"
PAGE: Final = "report.html"
PICTURE: Final = "candidates.png"
DESIGN_FILES: Final = (
    JSON,
    PAGE,
    SCENARIO,
    PICTURE,
    *(f"{LIBRARY}/{name}" for name in LIBRARY_FILES),
)
"""All names that a design may write: those of an earlier one give way."""
_FOOTER: Final = (
    "Thrust margin and lift over drag are the model's; collision force, recovery time and noise "
    "are Table III's, at 2000 rpm, or predicted from it. The same in design.json."
)


def design_page(design: Design, recommendation: Recommendation) -> Page:
    """Return the result of a design."""
    index = recommendation.index
    data = design_mapping(design, recommendation)
    why = [*data["reasons"], *data["must_give"]]
    fly = [] if index is None else [Text([f"tombo fly {SCENARIO}"], "command")]
    picture = Picture(
        lambda: draw_candidates(design, recommendation), "Figures against thrust margin"
    )
    return Page(
        title=f"Design: {data['headline']}",
        eyebrow="Tombo propeller design",
        headline=data["headline"],
        summary=f"{words.vehicle_and_limits(design)}. Law {design.request.law}.",
        cards=[] if index is None else _cards(design, index),
        sections=[
            Section("Why", [Text(why)]),
            Section("What can be had", [picture]),
            Section("Fly it, in this folder", fly, "page"),
            Section("Claimed and simulated", _check_table(recommendation.check)),
            Section("Candidates", [_candidate_table(design, recommendation)]),
            Section("Not measured", [Text(data["caveats"])]),
        ],
        data=data,
        footer=_FOOTER,
        verdict="nothing fits" if index is None else "recommended",
        verdict_style="bad" if index is None else "good",
    )


def write_design(
    folder: Path,
    design: Design,
    recommendation: Recommendation,
    on_progress: ProgressCallback = no_progress,
) -> None:
    """Write the files of a design into a folder that exists.

    Raises:
        OSError: they can't be written.
    """
    page = design_page(design, recommendation)
    (folder / JSON).write_text(page_json(page), encoding="utf-8", newline="\n")
    if recommendation.index is not None:
        configuration = design.evaluated.configurations[recommendation.index]
        strike = strike_of(design, recommendation.index)
        scenario = scenario_of(design.request, configuration, *strike)
        write_flyable(folder, scenario, configuration)
    on_progress("drawing", 0.5)
    (folder / PICTURE).write_bytes(figure_bytes(draw_candidates(design, recommendation)))
    write_page(folder / PAGE, page)


def _cards(design: Design, index: int) -> list[Card]:
    values = design.evaluated.value[index].tolist()
    return [
        Card(q.label, words.figure(value, q), q.unit, words.known(design, index, column))
        for column, (q, value) in enumerate(zip(QUANTITIES, values, strict=True))
    ]


def _check_table(check: Check | None) -> list[Item]:
    if check is None:
        return []
    rows = [
        (
            c.text,
            f"{c.claimed:.4g} {c.unit}".rstrip(),
            f"{c.simulated:.4g} {c.unit}".rstrip(),
            Cell("held", "good") if c.held else Cell("broken", "bad"),
        )
        for c in (*check.claims, *check.limits)
    ]
    fall = check.largest_fall_m
    falls = f" Falls {fall:.2f} m at most." if math.isfinite(fall) else ""
    note = f"{check.flights} flights into the pillar.{falls}"
    return [Table(("", "claimed", "simulated", ""), rows, note=note)]


def _candidate_table(design: Design, recommendation: Recommendation) -> Table:
    styles = {"recommended": "best", "fails in flight": "muted"}
    rows = [
        TableRow(
            [
                words.name_of(design, index),
                *(words.cell(design, index, column) for column in range(len(QUANTITIES))),
                why,
            ],
            styles.get(why, ""),
        )
        for index, why in words.candidates_shown(design, recommendation)
    ]
    head = ("candidate", *(f"{q.label} {q.unit}".strip() for q in QUANTITIES), "")
    return Table(head, rows, note=words.KEY)


def design_mapping(design: Design, recommendation: Recommendation) -> dict[str, Any]:
    """Return the content of `design.json`; None where it is not known."""
    choice, evaluated = design.choice, design.evaluated
    index = recommendation.index

    mapping: dict[str, Any] = plain(
        {
            "headline": words.headline(design, recommendation),
            "feasible": design.feasible,
            "flies_as_claimed": None
            if recommendation.check is None
            else recommendation.check.held,
            "recommended": None if index is None else candidate_mapping(design, index),
            "reasons": words.reasons(design, recommendation),
            "must_give": words.relief_lines(design),
            "check": _check(recommendation.check),
            "failed_in_flight": [
                {"candidate": candidate_mapping(design, i), "check": _check(c)}
                for i, c in recommendation.failed
            ],
            "alternatives": [
                {**candidate_mapping(design, i), "why": why}
                for i, why in words.alternatives(design, recommendation)
            ],
            "candidates": len(evaluated.configurations),
            "candidates_feasible": int(choice.feasible.sum()),
            "request": dataclasses.asdict(design.request),
            "limits": [limit.text for limit in choice.limits],
            "vehicle": dataclasses.asdict(design.vehicle),
            "thrust_error": design.thrust_error,
            "caveats": words.caveats(design, recommendation),
            "version": tombo_version(),
        }
    )
    return mapping


def candidate_mapping(design: Design, index: int) -> dict[str, Any]:
    """Return a candidate with its figures and how each is known."""
    evaluated = design.evaluated
    configuration = evaluated.configurations[index]
    operating = evaluated.operating
    return {
        "name": words.name_of(design, index),
        "conf": configuration.number,
        "nodus": describe(configuration),
        **dict(zip(PROPERTIES, evaluated.properties[index], strict=True)),
        "evidence": words.EVIDENCE[int(evaluated.tier[index])],
        "outside_of_tests": evaluated.outside(index),
        "hover_rpm": float(operating.hover_speed[index]) / RPM,
        "usable_rpm": float(operating.usable_speed[index]) / RPM,
        "usable_thrust_N": float(operating.usable_thrust[index]),
        "motor_limits_thrust": bool(operating.motor_limits[index]),
        "twist_in_hover_deg": math.degrees(float(operating.hover_twist[index])),
        "figures": {
            q.name: {
                "value": float(evaluated.value[index, k]),
                "low": float(evaluated.low[index, k]),
                "high": float(evaluated.high[index, k]),
                "counted": float(evaluated.counted[index, k]),
                "known": evaluated.labels[index, k],
            }
            for k, q in enumerate(QUANTITIES)
        },
    }


def _check(check: Check | None) -> dict[str, Any] | None:
    return None if check is None else {"held": check.held, **dataclasses.asdict(check)}
