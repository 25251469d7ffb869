"""Mappings proposed for real flights, where they are on this machine."""

from pathlib import Path

import pytest

from tombo_logs.proposal.explain import explain_mapping
from tombo_logs.readers.csv_mapping import parse_mapping, shipped

DATA = Path(__file__).resolve().parents[6] / "shared" / "data"
FLIGHTS = sorted((DATA / "flights").glob("*.csv.gz"))
SWARM = DATA / "crazyswarm2"
PAD = sorted((DATA / "crazypad").glob("*_1.csv.gz"))


@pytest.mark.slow
@pytest.mark.skipif(not FLIGHTS, reason=f"real data absent: no {DATA / 'flights'}")
def test_nanobench_gets_the_mapping_that_is_shipped_for_it():
    for path in FLIGHTS:
        assert parse_mapping(explain_mapping(path), "nanobench") == shipped()["nanobench"]


@pytest.mark.slow
@pytest.mark.skipif(not PAD, reason=f"real data absent: no {DATA / 'crazypad'}")
def test_what_crazypad_has_and_what_it_lacks():
    for path in PAD:
        text = explain_mapping(path)
        channels = parse_mapping(text, "m").channels
        assert set(channels) == {"position", "motor_command", "voltage"}, path.name
        assert channels["voltage"].unit == "mV" and "gravity is not in it" in " ".join(
            text.split()
        )
        motors = ("command_m1", "command_m3", "command_m4", "command_m2")
        assert channels["motor_command"].columns == motors
        assert "pitch not there" in text


@pytest.mark.slow
@pytest.mark.skipif(not SWARM.is_dir(), reason=f"real data absent: no {SWARM}")
@pytest.mark.parametrize(
    ("name", "position", "unit"),
    [("log160", "stateEstimateZ", "mm"), ("log22", "stateEstimateZ", "mm"),
     ("log201", "locSrv", "m"), ("log205", "locSrv", "m")],
)  # fmt: skip
def test_a_crazyswarm_flight_is_that_of_the_vehicle_in_its_units(name, position, unit):
    """From 201 on a payload hangs below, as stateEstimateZ.px; poses of the motion capture."""
    channels = parse_mapping(explain_mapping(SWARM / f"{name}.csv.gz"), "m").channels
    assert channels["position"].columns == tuple(f"{position}.{axis}" for axis in "xyz")
    assert channels["position"].unit == unit
    assert channels["attitude"].columns == tuple(f"ctrlLee.rpy{axis}" for axis in "xyz")
    assert channels["attitude"].unit == "rad"
