"""Stamps that say another time than the capture: who uses them, and when they are refused."""

import numpy as np
import pytest
from kernel_flight import NOISE, RATE, TICK, capture_ticks, fly_kernel

CAPTURES = capture_ticks(2.0)[:-1]
NONE_ARRIVES = {"mocap_dropouts": {"probability": 1.0, "duration": 9.0}}


def stamped(offset, delay=0.0, seconds=2.0, **more):
    effects = {"mocap_stamp_error": {"offset": offset}, "mocap_latency": {"delay": delay}} | more
    samples = round(seconds * RATE) + 1
    return fly_kernel(effects, seconds=seconds, mocap_noise=np.zeros((samples, NOISE)))


@pytest.mark.parametrize("offset", [-0.0304, 0.0123, 0.02])
def test_the_stamp_is_off_and_the_pose_is_that_of_the_capture(offset):
    f = stamped(offset, delay=0.03)
    captured = CAPTURES[: int(1.9 * RATE)]
    n = captured.size
    assert f.mocap["stamp"][:n] * TICK == pytest.approx(captured * TICK + offset, abs=1e-9)
    assert (f.mocap["position"][:n] == f["position"][captured]).all()
    ticks, rows = np.array(f.delivered).T
    assert (ticks - CAPTURES[rows] == 30).all()  # it arrives when it would


@pytest.mark.parametrize("offset", [-0.04, 0.0, 0.04])
def test_the_estimate_trails_by_the_error_of_the_stamp(offset):
    f = stamped(offset, delay=0.05, seconds=4.0)
    velocity, error = f["velocity"][:, 0], (f["est_position"] - f["position"])[:, 0]
    lag = -(error @ velocity) / (velocity @ velocity)
    assert lag == pytest.approx(offset, abs=0.008)


@pytest.mark.parametrize("offset", [0.006, 0.05, 0.2])
def test_a_stamp_from_the_future_is_refused(offset):
    """The estimate is the one of a flight without motion capture."""
    blind = fly_kernel(NONE_ARRIVES, seconds=2.0)
    f = stamped(offset)
    assert (f["est_position"] == blind["est_position"]).all()
    assert (f["position"] == blind["position"]).all()


def test_a_stamp_little_ahead_of_the_clock_waits_for_its_time():
    f = stamped(0.004)
    ticks, rows = np.array(f.delivered).T
    assert (ticks == CAPTURES[rows]).all()  # the estimator keeps it until then
    noise = {"imu_bias": {"accel_x": 0.2}}
    aided, blind = stamped(0.004, **noise), fly_kernel(noise | NONE_ARRIVES, seconds=2.0)
    errors = [np.abs(x["est_position"] - x["position"]).max() for x in (aided, blind)]
    assert errors[0] < 0.05 < errors[1]
