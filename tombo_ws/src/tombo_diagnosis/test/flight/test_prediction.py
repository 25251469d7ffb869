"""Residual of the true model in a flight without noise: nearly nothing, in every channel."""

from functools import cache

import numpy as np
import pytest
from measured_flights import LIVELY, ROTOR_DRAWS, SILENT, as_log, fly, nominal, with_hidden

from tombo_diagnosis.flight.fit.prediction import channels_of, motion_of, residuals
from tombo_diagnosis.flight.fit.track import track_of
from tombo_dynamics.effects.compose import layout

SENSORS = ("imu_rpm", "imu", "mocap_rpm", "mocap")
HIDDEN = {"steady_wind": {"east": 1.0}, "flapping_moment": {"k": 0.02}}


@cache
def fly_course(*hidden):
    effects = with_hidden({name: dict(values) for name, values in hidden}, SILENT)
    return fly(effects, LIVELY[0], draws=ROTOR_DRAWS)


def theta_of(hidden):
    theta = nominal(silent=True).theta
    for name, values in hidden.items():
        for parameter, value in values.items():
            theta[layout()[name][parameter]] = value
    return theta


def frozen(hidden):
    return tuple((name, tuple(values.items())) for name, values in hidden.items())


def rows_of(track, theta):
    """Return channel → (rows,) what is left, all formulations alike."""
    left = residuals(track, nominal(silent=True), theta, draws=ROTOR_DRAWS)
    result = {}
    channels = channels_of(track, nominal(silent=True))
    assert set(channels) == set(left)
    for group, rows in left.items():
        own = channels[group]
        assert rows.shape[1] == len(own)
        result |= {c.name: rows[:, j] for j, c in enumerate(own)}
    return result


LEFT = {
    "force": 0.05, "turning": 0.3, "rotor speed": 1.0, "mocap against accel": 0.05,
    "gyro against mocap": 0.02, "acceleration": 0.05, "voltage": 0.02, "latency": 0.6e-3,
}  # fmt: skip
"""Root mean square that interpolating poses of 30 Hz and ticks of 4 ms leaves, at most."""


def allowed(channel):
    return next(size for start, size in LEFT.items() if channel.startswith(start))


@pytest.mark.slow
@pytest.mark.parametrize("sensors", SENSORS)
def test_the_true_model_leaves_nearly_nothing(sensors):
    track = track_of(as_log(fly_course(*frozen(HIDDEN)), sensors=sensors))
    left = rows_of(track, theta_of(HIDDEN))
    assert track.formulation == sensors.split("_")[0]
    for name, rows in left.items():
        assert np.sqrt(np.mean(rows**2)) < allowed(name), name
    without = rows_of(track, theta_of({}))
    force = "force" if sensors.startswith("imu") else "acceleration"
    assert np.std(without[f"{force} x"]) + abs(np.mean(without[f"{force} x"])) > 0.1


FAULTS = {
    "tilted world": {"mocap_misalignment": {"yaw": 0.3, "roll": 0.02, "pitch": -0.03}},
    "turned world": {"mocap_misalignment": {"yaw": -3.0, "roll": 0.1}},
    "turned body": {"mocap_body_misalignment": {"yaw": 0.2, "roll": 0.03, "pitch": 0.02}},
    "marker aside": {"mocap_marker_offset": {"x": 0.04, "y": -0.03, "z": 0.05}},
    "early stamps": {"mocap_stamp_error": {"offset": -0.02}},
    "all of them": {
        "mocap_misalignment": {"yaw": -0.4, "pitch": 0.04},
        "mocap_body_misalignment": {"yaw": 0.2, "roll": 0.03},
        "mocap_marker_offset": {"x": 0.05, "z": 0.04},
        "mocap_stamp_error": {"offset": -0.015},
    },
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_motion_capture_is_undone_by_its_parameters(fault):
    """The motion behind the poses is the one that was flown."""
    hidden = FAULTS[fault]
    flight = fly_course(*frozen(hidden))
    track = track_of(as_log(flight))

    def off(theta):
        motion = motion_of(track, nominal(silent=True), theta).state
        # Without bound at the ends of the spline, where nothing is beyond the last pose.
        inner = (track.t > 3.0) & (track.t < track.t[-1] - 0.5)
        rows = np.clip(np.round(track.t[inner] * 1000).astype(int), 0, flight.t.size - 1)
        place = np.abs(motion[inner, :3] - flight.log["position"][rows]).max()
        same = np.abs(np.sum(motion[inner, 6:10] * flight.log["attitude"][rows], axis=1))
        turn = 2.0 * np.arccos(np.clip(same, 0.0, 1.0)).max()
        return place, turn

    place, turn = off(theta_of(hidden))
    assert place < 2e-3 and turn < 0.02
    raw_place, raw_turn = off(theta_of({}))
    assert raw_place > 5.0 * place or raw_turn > 5.0 * turn
