"""The page of why a flight went wrong."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from tombo_diagnosis.crash.reason import CAUSES, Why, why_mapping
from tombo_diagnosis.report.page import check_items
from tombo_diagnosis.wording import display_name, listed
from tombo_flight.report import style
from tombo_flight.report.page import Page, Picture, Section, Table
from tombo_flight.report.style import new_figure

_AROUND_S: Final = (1.5, 2.0)
"""Before and after the first deviation, in the picture."""


def why_page(found: Why) -> Page:
    """Return the page of an answer: cause, time, chain of evidence."""
    rows = [
        [f"{s.time:.2f} s", display_name(CAUSES.get(s.kind, s.kind)), s.text]
        for s in found.timeline
    ]
    against = [finding for finding in found.findings if finding.severity != "info"]
    certain = f"{100 * found.confidence:.0f} %"
    picture = Picture(
        partial(draw_why, found), "Grey: signs; red: the first deviation.", "Around it"
    )
    return Page(
        title=f"Why: {found.flight.name}",
        eyebrow="Tombo why",
        headline=_headline(found),
        summary=f"Of {found.flight.source or found.flight.name}, from that log alone.",
        sections=[
            Section(
                "What was seen", [Table(["time", "speaks for", "sign"], rows)] if rows else []
            ),
            Section(
                "What the checks have against the log",
                check_items(against, "log") if against else [],
            ),
            Section("Around it", [picture] if found.time_s is not None else [], "page"),
        ],
        data=why_mapping(found),
        verdict=f"{display_name(found.cause)} · {certain}",
        verdict_style="good" if found.cause == "none" else "bad",
    )


def _headline(found: Why) -> str:
    if found.time_s is None:
        return "Nothing wrong"
    causes = [CAUSES[m] for m in found.members] if found.cause == "set" else [found.cause]
    told = listed(causes, "or")
    if found.cause == "unknown":
        told = "something went wrong; the log does not tell the cause"
    return f"At {found.time_s:.2f} s: {told}"


def draw_why(found: Why) -> Figure:
    """Draw height, lean, rates and demand around the first deviation."""
    m = found.motion
    at = found.time_s or 0.0
    rows = slice(m.index(at - _AROUND_S[0]), m.index(at + _AROUND_S[1]) + 1)
    with new_figure(9.0, 6.0, 100, layout="constrained") as sheet:
        axes = sheet.subplots(4, 1, sharex=True)
        for ax, values, name in (
            (axes[0], m.height, "height [m]"),
            (axes[1], np.degrees(m.tilt), "lean [°]"),
            (axes[2], m.rates, "rates [rad/s]"),
            (axes[3], m.demand, "demand over hover"),
        ):
            ax.plot(m.t[rows], values[rows], linewidth=1.0)
            ax.set_ylabel(name)
            for sign in found.timeline:
                if m.t[rows][0] <= sign.time <= m.t[rows][-1]:
                    ax.axvline(sign.time, color=style.MUTED, linewidth=0.5)
            ax.axvline(at, color=style.VERMILLION, linewidth=1.0)
        axes[3].set_xlabel("time [s]")
    return sheet
