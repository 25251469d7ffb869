"""Columns of a trace: which is which, and the unit of time."""

import numpy as np
import pytest

from tombo_propeller.rotor_trace import read_trace


def write(path, heading, value=5.0, step=1e-3):
    rows = (f"{k * step:.6f},{value}" for k in range(50))
    path.write_text("\n".join([heading, *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("heading", "is_speed", "factor"),
    [
        ("time,thrust", False, 1.0),
        ("time_s,force [gf]", False, 1.0),
        ("time_ms,rpm", True, 1e-3),
        ("time [us],omega_rad_s", True, 1e-6),
        ("t,speed [Hz]", True, 1.0),
    ],
)
def test_a_heading_says_kind_and_unit_of_time(tmp_path, heading, is_speed, factor):
    trace = read_trace(write(tmp_path / "t.csv", heading, step=2.0), tare=1.0)
    assert trace.is_speed == is_speed
    assert trace.value == pytest.approx(np.full(50, 4.0))
    assert trace.time[1] == pytest.approx(2.0 * factor)
