"""A figure that several pages quote is the same on each of them, and as in the code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

from tombo_benchmarks.docs.markdown import marked

ROOT = Path(__file__).parents[2]
README, DOCS, SRC = "README.md", "docs", "tombo_ws/src/tombo_dynamics/tombo_dynamics"
REPRODUCTION, EVIDENCE = f"{DOCS}/reproduction.md", f"{DOCS}/evidence.md"

FIGURES: Final = {
    "claims of the paper": (
        (REPRODUCTION, r"paper’s (\d+) claims (\d+) hold [^,]*, (\d+) fail.*?(\d+) can"),
        (REPRODUCTION, r"paper's (\d+) claims (\d+) hold, (\d+) fail.*?(\d+) can"),
        (EVIDENCE, r"paper's (\d+) claims (\d+) hold, (\d+) fail.*?(\d+) can"),
    ),
    "own checks of the paper that fail": (
        (REPRODUCTION, r"our own (\d+) checks.*?(\d+) fail"),
        (REPRODUCTION, r"Of (\d+) checks of our own, (\d+) fail"),
        (EVIDENCE, r"Of (\d+) checks of our own, (\d+) fail"),
    ),
    "pieces of the rotor's map": (
        (f"{SRC}/rotor_maps.py", r"_PIECES = (\d+)"),
        (f"{DOCS}/model.md", r"torque: (\d+) monotone cubics"),
        (f"{DOCS}/propeller.md", r"\[(\d+) pieces\]"),
    ),
    "pieces of the propeller's map": (
        (f"{SRC}/propeller/thrust_map.py", r"_CELLS = (\d+)"),
        (f"{DOCS}/propeller.md", r"has (\d+) monotone cubics"),
    ),
    "crashes of bounce at 0.7 and 1.2 m/s": (
        (f"{DOCS}/sweep.md", r"`paper_collision` \| 0 / (\d+) \| (\d+) / (\d+) \|"),
        (README, r"with disturbances \| (\d+) of 100.*?(\d+) of 100 crash.*?(\d+) of 100 crash"),
    ),
    "crashes of reflex at the pole": (
        (f"{DOCS}/sweep.md", r"^\| `pole` \| (\d+) \| 286"),
        (README, r"thin pole, with disturbances \| (\d+) of 300"),
        (EVIDENCE, r"and (\d+) times at the pole"),
    ),
    "crashes of reflex at 1.5 m/s": (
        (f"{DOCS}/sweep.md", r"^\| at 1.5 m/s \| (\d+) \|"),
        (README, r"1.5 m/s, with disturbances \| (\d+) of 300"),
        (EVIDENCE, r"crashes (\d+) times at 1.5 m/s"),
    ),
    "CrazyPAD: in a set, wrong": (
        (
            f"{DOCS}/diagnosis_benchmarks.md",
            r"ten conditions, `--healthy` \| 10 \| 0 \| (\d+) \| (\d+) \|",
        ),
        (f"{DOCS}/changed.md", r"nine others: (\d+) right \(all in a set\), (\d+) wrong"),
        (EVIDENCE, r"Crazyflie, (\d+) are right in a set.*?and (\d+) are wrong"),
    ),
    "losses over PX4": ((README, r"in SITL, (\d+) losses"), (EVIDENCE, r"at 2 m; (\d+) losses")),
    "fall of reflex over PX4": (
        (f"{DOCS}/px4.md", r"the vehicle falls ([\d.]+) m in the median"),
        (README, r"the median fall is ([\d.]+) m"),
    ),
    "largest drift after a loss": (
        (f"{DOCS}/faults.md", r"drifts by at most ([\d.]+) m"),
        (f"{DOCS}/requirements.md", r"side \| ([\d.]+) m"),
        (f"{DOCS}/first_real_flight.md", r"\| ([\d.]+) m of room to each side"),
    ),
    "largest fall over PX4": (
        (f"{DOCS}/px4.md", r"falls \[m\] \|[^\n]*?at most ([\d.]+) \|"),
        (f"{DOCS}/requirements.md", r"below the flight \| ([\d.]+) m"),
        (f"{DOCS}/first_real_flight.md", r"side, ([\d.]+) m of height"),
    ),
}
"""Figure → (page or source, pattern whose groups are the figure), the source first.

A space of a pattern is any white space.
"""


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_has_one_value_on_all_pages(name):
    values = {
        (page, pattern): found.groups() if found else None
        for page, pattern in FIGURES[name]
        for found in [
            re.search(pattern.replace(" ", r"\s+"), (ROOT / page).read_text("utf-8"), re.M | re.S)
        ]
    }
    assert len(set(values.values())) == 1 and None not in values.values(), values


def test_the_losses_are_as_many_as_the_table_has():
    table = marked((ROOT / DOCS / "faults.md").read_text(encoding="utf-8"), "px4_losses")
    losses = re.search(r"SITL, (\d+) losses", (ROOT / README).read_text(encoding="utf-8"))
    assert losses is not None
    assert int(losses[1]) == table.count(" of 1 |")
