"""`tombo benchmark foreign`: the answers about cases of another simulator, and their score."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from tombo_benchmarks.diagnosis import foreign_flights
from tombo_benchmarks.diagnosis.foreign_flights import aggregate, answer_of, cases_in, examine

MASS = {"mass_error.fraction": 0.1}


def diagnosed(verdict, *causes, members=()):
    """A diagnosis that has fitted each cause's `fraction` from 0.08 to 0.11."""
    theta = (SimpleNamespace(name="fraction", value=0.1, low=0.08, high=0.11),)
    return SimpleNamespace(
        verdict=verdict, causes=[SimpleNamespace(effect=c, theta=theta) for c in causes],
        set=members, confidence=0.9, summary="", seconds=1.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("diagnosis", "hidden", "answer"),
    [
        (diagnosed("named", "mass_error"), {"mass_error"}, "right"),
        (diagnosed("named", "mass_error"), set(), "wrong"),
        (diagnosed("named", "gusts"), {"mass_error"}, "wrong"),
        (diagnosed("set", "gusts", members=("gusts", "mass_error")), {"mass_error"}, "in a set"),
        (diagnosed("partly_explained", "mass_error", "gusts"), {"mass_error"}, "in a set"),
        (diagnosed("none"), set(), "right"),
        (diagnosed("none"), {"mass_error"}, "withheld"),
        (diagnosed("unknown"), set(), "withheld"),
    ],
)
def test_answers(diagnosis, hidden, answer):
    assert answer_of(diagnosis, hidden) == answer


@pytest.fixture
def cases(tmp_path):
    """Two cases without flights."""
    for name, truth in (("000_mass", MASS), ("001_none", {})):
        (tmp_path / name).mkdir()
        said = {"condition": name[4:], "truth": truth}
        (tmp_path / name / "truth.json").write_text(json.dumps(said))
    return tmp_path


def test_each_condition_is_scored_and_intervals_are_held_against_the_truth(cases, monkeypatch):
    for name in ("read_logs", "read_vehicle", "held_against", "nominal_model"):
        monkeypatch.setattr(foreign_flights, name, lambda *args, **more: None)
    named = diagnosed("named", "mass_error")
    monkeypatch.setattr(foreign_flights, "diagnose_unchecked", lambda *args: [named])
    said = aggregate([examine(cases_in(cases), 0, number) for number in (0, 1)])
    assert (said["cases"], said["right"], said["wrong"], said["coverage_95"]) == (2, 1, 1, 1.0)
    assert said["conditions"]["mass"]["right"] == said["conditions"]["none"]["wrong"] == 1


def test_flights_that_are_refused_are_withheld(tombo, cases):
    words = ("benchmark", "foreign", str(cases), "--workers", "1")
    assert "2 cases of another simulator" in tombo(*words).out
    said = tombo(*words, "--json").json["aggregate"]
    assert (said["withheld"], said["stated"]) == (2, None)
