"""Units in a trace's headings, and contradictions."""

import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_propeller.rotor_trace import read_trace


def write(path, heading, value=5.0, step=1e-3):
    rows = (f"{k * step:.6f},{value}" for k in range(50))
    path.write_text("\n".join([heading, *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    "heading, kind, unit",
    [
        ("time,thrust", "thrust", "N"),
        ("time,thrust_N", "thrust", "N"),
        ("time,thrust_mN", "thrust", "mN"),
        ("time,force [gf]", "thrust", "gf"),
        ("time,thrust (kgf)", "thrust", "kgf"),
        ("time,rpm", "speed", "rpm"),
        ("time,speed_rpm", "speed", "rpm"),
        ("time,speed", "speed", "rad/s"),
        ("time,omega_rad_s", "speed", "rad/s"),
        ("time,speed [Hz]", "speed", "Hz"),
    ],
)
def test_a_heading_says_kind_and_unit_and_values_stay_in_it(tmp_path, heading, kind, unit):
    trace = read_trace(write(tmp_path / "t.csv", heading), tare=1.0)
    assert (trace.kind, trace.unit) == (kind, unit)
    assert trace.is_speed == (kind == "speed")
    assert trace.value == pytest.approx(np.full(50, 4.0))


@pytest.mark.parametrize(
    "heading, unit",
    [
        ("time,thrust_N", "rpm"),
        ("time,thrust_N", "gf"),
        ("time,rpm", "N"),
        ("time,speed_rpm", "rad/s"),
        ("time,thrust", "rpm"),
        ("time,speed", "N"),
    ],
)
def test_a_unit_that_the_heading_contradicts_is_refused(tmp_path, heading, unit):
    with pytest.raises(InputError, match=f"--unit {unit}.*{heading.split(',')[1]}.*accepted"):
        read_trace(write(tmp_path / "t.csv", heading), unit=unit)


def test_a_unit_that_the_heading_leaves_open_is_taken(tmp_path):
    path = write(tmp_path / "t.csv", "time,thrust,sensor")
    assert read_trace(path, unit="gf").unit == "gf"


@pytest.mark.parametrize(
    "heading, factor",
    [("time,rpm", 1.0), ("time_s,rpm", 1.0), ("time_ms,rpm", 1e-3), ("time [us],rpm", 1e-6)],
)
def test_time_is_in_the_unit_of_its_heading(tmp_path, heading, factor):
    path = write(tmp_path / "t.csv", heading, step=2.0)
    assert read_trace(path).time[1] == pytest.approx(2.0 * factor)


def test_a_unit_of_time_that_the_heading_contradicts_is_refused(tmp_path):
    path = write(tmp_path / "t.csv", "time_ms,rpm")
    assert read_trace(path, time_unit="ms").time[1] == pytest.approx(1e-6)
    with pytest.raises(InputError, match=r"--time-unit s .*time_ms.*accepted: ms"):
        read_trace(path, time_unit="s")
