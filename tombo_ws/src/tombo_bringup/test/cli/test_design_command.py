"""`tombo propeller design` on the command line."""

import pytest

from tombo_bringup.cli.propeller.design_command import INFEASIBLE
from tombo_propeller.design import candidates

pytestmark = pytest.mark.slow

EASY = ("--mass", "1.3", "--min-thrust-margin", "1.7", "--max-collision-force", "150")


def design(tombo, *arguments):
    return tombo("propeller", "design", *arguments)


def test_a_design_leaves_everything_to_fly_it(tombo, tmp_path):
    result = design(tombo, *EASY, "--flights", "3", "-o", "out", "--json")
    assert result.code == 0
    values = result.json
    assert values["recommended"]["conf"] == 11
    assert values["flies_as_claimed"] is True
    assert values["recommended"]["figures"]["recovery_s"]["known"] == "measured"
    assert values["recommended"]["figures"]["thrust_margin"]["known"] == "extrapolated"
    assert values["check"]["flights"] == 3
    written = {p.name for p in (tmp_path / "out").iterdir()}
    assert written == {"design.json", "report.html", "design.yaml", "candidates.png"}
    assert (tmp_path / "out" / "design.json").read_text() == result.out
    assert "http" not in (tmp_path / "out" / "report.html").read_text().replace("http-equiv", "")
    flown = tombo("fly", "out/design.yaml", "--json", "-o", "flight")
    assert flown.code == 0
    assert flown.json["conf"] == 11
    assert not flown.json["crashed"]


@pytest.fixture
def few_candidates(monkeypatch):
    """A grid as coarse as words need it."""
    monkeypatch.setattr(candidates, "FIBRE_COUNTS", (3, 5, 8))
    monkeypatch.setattr(candidates, "DIAMETERS_MM", (0.5, 0.9))
    monkeypatch.setattr(candidates, "LENGTHS_MM", (8.0, 12.0, 16.0))
    monkeypatch.setattr(candidates, "OUTER_RADII_MM", (35.0, 45.0))


def test_nothing_feasible_says_what_must_give(tombo, few_candidates):
    result = design(tombo, "--mass", "2.5", "--max-collision-force", "150")
    assert result.code == INFEASIBLE
    assert "No candidate keeps to all limits" in result.out
    assert "thrust margin at least 2: must be" in result.out
    assert not result.err
