"""The flights of a Crazyflie under a Vicon, where they are on this machine."""

from pathlib import Path

import pytest

from tombo_bag.flight import Series
from tombo_logs.checks import check_log
from tombo_logs.checks.rotors.rotor_order import rotor_order
from tombo_logs.readers.log_reader import read_logs

FOLDER = Path(__file__).resolve().parents[6] / "shared" / "data" / "flights"
CRASH = "B2_circle_medium_rep3"

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"real data absent: no {FOLDER}")


@pytest.fixture(scope="module")
def flights():
    return {log.name: check_log(log) for log in read_logs([FOLDER])}


def spans(log, check):
    return [(f.start_s, f.end_s) for f in log.findings if f.check == check]


@pytest.mark.slow
def test_the_crash_is_found_where_it_is_and_nowhere_else(flights):
    """On-board data end at 31.28 s and are a straight line from there, past 2.5 g at 32.18 s."""
    for name, log in flights.items():
        assert bool(spans(log, "crash")) == (name == CRASH)
        assert not spans(log, "contact")
    (crash,) = [f for f in flights[CRASH].findings if f.check == "crash"]
    assert "at 32.18 s" in crash.message and "straight line" in crash.message
    last = flights[CRASH].exclude[-1]
    assert 30.5 < last[0] < 31.28 and last[1] == flights[CRASH].series["position"].t[-1]


@pytest.mark.slow
def test_markers_swap_twice_and_hard_stops_are_no_jumps(flights):
    """At 35.8 s of B10 and 20.8 s of B3 the vehicle itself turns as fast, and the gyro says so."""
    jumps = {name: [b for b, _ in spans(log, "jump")] for name, log in flights.items()}
    assert jumps.pop(CRASH) == pytest.approx([19.06], abs=0.1)
    assert jumps.pop("B2_circle_fast_rep1") == pytest.approx([14.44], abs=0.1)
    assert not any(jumps.values())


def test_the_motors_of_the_file_are_not_in_our_order(flights):
    """M1 to M4 run clockwise from front right: taken as they come, the gyro contradicts."""
    log = flights["B2_circle_fast_rep1"]
    drive, gyro = log.series["motor_command"], log.series["gyro"]
    m1_to_m4 = Series(drive.t, drive.values[:, [0, 3, 1, 2]])
    assert rotor_order(log.name, "motor_command", m1_to_m4, gyro, list(log.exclude))
    assert not rotor_order(log.name, "motor_command", drive, gyro, list(log.exclude))
