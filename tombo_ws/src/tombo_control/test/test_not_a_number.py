"""Measurements may be missing: no combination of NaN reaches the rotors or stays inside."""

import itertools
import math

import numpy as np
import pytest
from control_bench import FOREVER, fresh_autopilot, rotor_table

from tombo_control.estimator import correct, predict, store_history, update_body_rates
from tombo_control.loops.cascade import cascade
from tombo_dynamics.records import numbers
from tombo_dynamics.vehicle import GRAVITY, VehicleParams

IMU = np.array([0.02, -0.01, 0.03, 0.1, -0.1, GRAVITY])
POSE = np.array([0.01, 0.02, 10.01, 0.0, 0.0, 0.0, 1.0])
SPOILT = [("imu", i) for i in range(6)] + [("pose", 0), ("pose", 2), ("pose", 5)]


def fly(a, imu, pose, first, ticks):
    for k in range(first, first + ticks):
        store_history(a.state, a.history, k)
        if k % 33 == 0:
            correct(a, pose[:3], pose[3:], k, k, 0.033, True)
        update_body_rates(a.state, imu[:3])
        cascade(a, rotor_table(), k)
        command = a.setpoint.rotor_speed
        assert np.isfinite(command).all()
        assert command.min() >= 0.9 * VehicleParams().rotor_speed_min
        assert command.max() <= VehicleParams().rotor_speed_max
        predict(a.state, imu[3:], True)


@pytest.mark.slow
def test_all_512_combinations():
    for chosen in itertools.product([False, True], repeat=len(SPOILT)):
        a = fresh_autopilot()
        a.mocap_time = FOREVER
        imu, pose = IMU.copy(), POSE.copy()
        for spoil, (where, i) in zip(chosen, SPOILT, strict=True):
            if spoil:
                (imu if where == "imu" else pose)[i] = math.nan
        fly(a, IMU, POSE, 0, 20)
        fly(a, imu, pose, 20, 20)
        fly(a, IMU, POSE, 40, 20)
        for part in (a.state, a.setpoint, a.loops):
            assert np.isfinite(numbers(part)).all()
