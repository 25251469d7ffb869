"""`tombo diagnose NEW... --healthy OLD` on the command line, from files to the answer."""

from __future__ import annotations

from pathlib import Path

import pytest

from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import write_mcap
from tombo_flight.scenario import load_scenario

ONE_VEHICLE = "effects.thrust_scatter.deviation=0"


def fly(name, seed, *more):
    scenario = load_scenario("hover", (ONE_VEHICLE, "duration=12", *more))
    path = Path(f"{name}.mcap")
    path.parent.mkdir(exist_ok=True)
    write_mcap(fly_scenario(scenario, seed), path)
    return str(path)


def fly_before():
    """Leave two healthy flights in a folder; return it."""
    for seed in (0, 1):
        fly(f"old/before{seed}", seed)
    return "old"


@pytest.mark.slow
def test_a_weak_propeller_hidden_in_a_flight_of_the_suite_is_found(tombo, tmp_path):
    before = fly_before()
    new = fly("new", 7, "effects.weak_propeller.rear_left=0.1")
    one = ("--session", "today=*")
    result = tombo("diagnose", new, "--healthy", before, *one, "--json")
    assert (result.code, result.err) == (0, "")
    assert result.json["verdict"] in ("named", "set")
    assert {c["rotor"] for c in result.json["changed"]} == {"rear_left"}
    first = result.json["changed"][0]
    assert first["effect"] == "weak_propeller"
    assert first["theta"]["rear_left"]["value"] == pytest.approx(0.1, abs=0.02)
    again = fly("again", 8)
    shown = tombo("diagnose", again, "--healthy", before, *one, "-o", "out")
    assert shown.out.startswith("Nothing has changed that these flights show")
    names = {str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob("*.*")}
    assert names == {"diagnosis.json", "report.html"}
