"""The command, its files, and the page in docs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tombo_benchmarks.docs.markdown import marked
from tombo_benchmarks.docs.tables import claims_markdown
from tombo_bringup.cli.main import run
from tombo_flight.report.figures import BY_KEY
from tombo_propeller.reproduce.page import REPRODUCTION_FILES
from tombo_propeller.reproduce.paper_values import read_paper
from tombo_propeller.reproduce.plots import FIGURES
from tombo_propeller.reproduce.reproduction import reproduce

ROOT = Path(__file__).parents[5]


def tombo(*arguments: str) -> int:
    with pytest.raises(SystemExit) as leave:
        run(["propeller", "reproduce", *arguments])
    return int(leave.value.code or 0)


@pytest.mark.slow
def test_folder_holds_page_json_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    assert tombo("-o", str(folder), "--law", "published", "--law", "consistent") == 0
    assert {p.name for p in folder.iterdir()} == set(REPRODUCTION_FILES)
    content = json.loads((folder / "reproduction.json").read_text())
    assert list(content["computed"]["laws"]) == ["published", "consistent"]
    page = (folder / "reproduction.html").read_text()
    assert page.count("<figure ") == len(FIGURES)
    assert not re.search(r"(src|href)=\"(?!data:|#)", page), "the page needs nothing else"
    assert not re.search(r"\{\{|\{\w+[:.]", page.split("</style>")[1])
    for claim in content["claims"]:
        assert f'id="{claim["name"]}"' in page
    for name in FIGURES:
        assert (folder / name).read_bytes().startswith(b"\x89PNG")
    out = capsys.readouterr().out
    assert "Of the paper’s" in out and "reproduction.html" in out
    assert tombo("-o", str(folder)) == 2
    assert "not empty" in capsys.readouterr().err


def test_the_page_in_docs_is_up_to_date() -> None:
    page = (ROOT / "docs" / "reproduction.md").read_text()
    written = claims_markdown(reproduce())
    assert marked(page, "claims") == written, "run: make docs ARGS=reproduction"


def test_flight_figures_are_those_of_the_readme_and_the_flight_report() -> None:
    paper = read_paper()
    readme = (ROOT / "README.md").read_text()
    campaign = paper.texts["campaign"]
    assert f"| yes | {campaign['recovered']} of {campaign['flights']} |" in readme
    for name in ("falls_m", "unstable_s", "whole_recovery_s"):
        unit = name.rpartition("_")[2]
        assert f"| {campaign[name]} {unit} ({campaign[f'{name}_range']})" in readme
    for name, value in (
        ("collision_point_m", BY_KEY["x_c_m"].paper),
        ("response_point_m", BY_KEY["x_r_m"].paper),
    ):
        assert tuple(p.value for p in paper.point("flight", name)) == value
    assert paper.number("flight", "bounce_m").value == BY_KEY["bounce_m"].paper
    assert paper.number("flight", "unstable_s").value == BY_KEY["unstable_phase_s"].paper
    assert paper.number("flight", "falls_m").value == BY_KEY["max_falling_distance_m"].paper
