"""Commands that an output prints for the reader are run as they stand."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import write_mcap
from tombo_flight.scenario import load_scenario

pytestmark = pytest.mark.slow


def run_printed(tombo, text: str) -> list[str]:
    """Run each `tombo ...` that stands alone on a line or ends one; return their first words."""
    lines = re.findall(r"(?:^|: )\s*(tombo [a-z]+ .+?)$", text, flags=re.MULTILINE)
    names = []
    for line in lines:
        _, *words = shlex.split(line)
        result = tombo(*words)
        assert result.code == 0, f"{line}: {result.err}"
        names.append(words[0])
    return names


def test_the_commands_of_a_diagnosis_with_another_vehicle(tombo):
    """The vehicle's name and the model's file are in the command."""
    hidden = ["effects.mass_error.fraction=0.15"]
    for seed in (1, 2):
        scenario = load_scenario("survey", hidden, vehicle="px4_x500")
        write_mcap(fly_scenario(scenario, seed), Path(f"f{seed}.mcap"))
    result = tombo(
        *("diagnose", "f1.mcap", "f2.mcap", "--vehicle", "px4_x500"),
        *("-o", "a why", "--no-report"),
    )
    assert result.code == 0, result.err
    assert "--vehicle px4_x500" in result.out
    assert run_printed(tombo, result.out) == ["fly"]
