"""Pictures of the page of evidence, drawn from the tables of other pages.

A picture carries its rows in its description, so a test can compare it with the tables.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tombo_benchmarks.docs.markdown import marked, table_rows
from tombo_flight.report import style
from tombo_flight.report.style import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = Sequence[str]

TABLES: Final = {
    "crash_rates.png": ("sweep.md", "arena"),
    "confidence.png": ("diagnosis_benchmarks.md", "confidence"),
    "px4_losses.png": ("faults.md", "px4_losses"),
}
"""Picture → page and table that it is drawn from."""

_REACTIONS: Final = {
    "none": style.MUTED,
    "bounce": style.VERMILLION,
    "admittance": style.ORANGE,
    "mpc": style.BLUE,
    "reflex": style.GREEN,
}
_SPEEDS: Final = {"0.5 m/s": 0.5, "paper_collision": 0.7, "0.9 m/s": 0.9, "1.2 m/s": 1.2,
                  "1.5 m/s": 1.5}  # fmt: skip
"""Collision of the table → approach speed [m/s]."""
_OBSTACLES: Final = ("paper_collision", "pillar_right", "pillar_wide", "pole", "short_strike",
                     "side_hit", "rear_hit")  # fmt: skip


def draw_evidence(docs: Path) -> None:
    """Draw all pictures of the page of evidence into the folder of the pages."""
    for (name, (page, table)), draw in zip(
        TABLES.items(), (_crash_rates, _confidence, _losses), strict=True
    ):
        rows = table_rows(marked((docs / page).read_text(encoding="utf-8"), table))
        with new_figure(9.0, 3.9, 110, 9.0, layout="constrained") as figure:
            draw(figure, rows)
            figure.savefig(docs / name, metadata={"Description": json.dumps(rows)})


def _crash_rates(figure: Figure, rows: Sequence[Row]) -> None:
    """Draw crash rates with their intervals over speed and over obstacle, a colour a reaction."""
    rates: dict[tuple[str, str], list[float]] = {}
    collision = ""
    for collision_cell, reaction, crashed, *_ in rows:
        collision = collision_cell or collision
        count, flights, low, high = map(float, re.findall(r"[\d.]+", crashed))
        rates[collision, reaction] = [100.0 * count / flights, low, high]
    over_speed, over_obstacle = figure.subplots(1, 2, sharey=True)
    for k, (reaction, colour) in enumerate(_REACTIONS.items()):
        aside = 0.11 * (k - 2)
        speeds = [v + 0.1 * aside for v in _SPEEDS.values()]
        _bars(over_speed, speeds, [rates[c, reaction] for c in _SPEEDS], colour, "o-", reaction)
        places = [n + aside for n in range(len(_OBSTACLES))]
        _bars(over_obstacle, places, [rates[c, reaction] for c in _OBSTACLES], colour, "o", "")
    over_speed.set(xlabel="approach speed [m/s], pillar", ylabel="crashed of 30 flights [%]")
    over_speed.set_xticks(list(_SPEEDS.values()))
    over_speed.set_title("over speed", loc="left")
    over_speed.set_ylim(-3.0, 103.0)
    figure.legend(loc="outside upper center", ncols=5)
    names = [name.replace("paper_collision", "pillar").replace("_", " ") for name in _OBSTACLES]
    over_obstacle.set_xticks(range(len(names)), names, rotation=20)
    over_obstacle.set_title("over obstacle and direction, 0.7 m/s", loc="left")


def _bars(
    axes: Axes, at: Sequence[float], rates: Sequence[Sequence[float]], colour: str, line: str,
    label: str,
) -> None:  # fmt: skip
    """Draw rates [%] with their intervals; each is a value, its lower and its upper end."""
    values = [value for value, _, _ in rates]
    below = [max(0.0, value - low) for value, low, _ in rates]
    above = [max(0.0, high - value) for value, _, high in rates]
    axes.errorbar(at, values, (below, above), fmt=line, ms=4, lw=1.2, elinewidth=0.8, color=colour,
                  label=label)  # fmt: skip


def _confidence(figure: Figure, rows: Sequence[Row]) -> None:
    """Draw the share of right answers over the stated confidence, with Wilson's intervals."""
    axes = figure.subplots()
    axes.plot((50, 100), (50, 100), "--", color=style.MUTED, lw=1.0, label="as stated")
    shares = []
    for _, _, stated, share, interval in rows:
        shares.append([_number(stated), _number(share), *map(float, re.findall(r"\d+", interval))])
    _bars(axes, [mean for mean, *_ in shares], [rate for _, *rate in shares], style.BLUE, "o",
          "right, with 95 % interval")  # fmt: skip
    for row, (mean, right, *_) in zip(rows, shares, strict=True):
        axes.annotate(f"{row[1]} answers", (mean, right), (-7, -3), textcoords="offset points",
                      ha="right")  # fmt: skip
    axes.set(xlabel="mean stated confidence [%]", ylabel="right answers [%]")
    axes.set(xlim=(50.0, 102.0), ylim=(45.0, 103.0))
    axes.legend(loc="lower right")


def _losses(figure: Figure, rows: Sequence[Row]) -> None:
    """Draw each loss as a time line: from the loss to the ground, and until it is disarmed."""
    axes = figure.subplots()
    names = [row[0] for row in rows]
    down, disarmed = ([_number(row[k]) for row in rows] for k in (2, 3))
    axes.barh(names, down, color=style.RECOVERY, label="until it is on the ground")
    rest = [b - a for a, b in zip(down, disarmed, strict=True)]
    axes.barh(names, rest, left=down, color=style.BLUE, label="until the rotors are disarmed")
    for place, end in enumerate(disarmed):
        axes.annotate(f"{end:.1f} s", (end, place), (4, -3), textcoords="offset points")
    axes.invert_yaxis()
    axes.set(xlabel="time after the loss [s]")
    axes.grid(visible=False, axis="y")
    axes.legend(loc="center right")


def _number(cell: Any) -> float:
    return float(str(cell).removesuffix("%"))
