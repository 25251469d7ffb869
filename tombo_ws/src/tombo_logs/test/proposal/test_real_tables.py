"""Mappings proposed for real flights, where they are on this machine."""

from pathlib import Path

import pytest

from tombo_logs.proposal.explain import explain_mapping
from tombo_logs.readers.csv_mapping import parse_mapping, shipped

DATA = Path(__file__).resolve().parents[6] / "shared" / "data"
FLIGHTS = sorted((DATA / "flights").glob("*.csv.gz"))
PAD = sorted((DATA / "crazypad").glob("*_1.csv.gz"))


@pytest.mark.slow
@pytest.mark.skipif(not FLIGHTS, reason=f"real data absent: no {DATA / 'flights'}")
def test_nanobench_gets_the_mapping_that_is_shipped_for_it():
    """That one was found by hand: rad/s although others of this vehicle are in deg/s."""
    known = shipped()["nanobench"]
    for path in FLIGHTS:
        text = explain_mapping(path)
        found = parse_mapping(text, "m")
        assert (found.time, found.world, found.body) == (known.time, known.world, known.body)
        assert found.channels == known.channels, path.name
        assert found.airframe == known.airframe


@pytest.mark.slow
@pytest.mark.skipif(not PAD, reason=f"real data absent: no {DATA / 'crazypad'}")
def test_what_crazypad_has_and_what_it_lacks():
    for path in PAD:
        text = explain_mapping(path)
        channels = parse_mapping(text, "m").channels
        assert set(channels) == {"position", "acceleration", "motor_command", "voltage"}, path.name
        assert channels["acceleration"].unit == "g" and channels["voltage"].unit == "mV"
        motors = ("command_m1", "command_m3", "command_m4", "command_m2")
        assert channels["motor_command"].columns == motors
        assert "pitch not there" in text
