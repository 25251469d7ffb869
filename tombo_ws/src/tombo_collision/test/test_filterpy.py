"""The compiled filter is filterpy's: same state, covariance and statistic to 1e-12."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from pose_bench import flight

from core_calls import CollisionDetector
from tombo_collision.detector import free_acceleration
from tombo_collision.params import DetectorParams
from tombo_dynamics.rotation import rotation_vector

RATE_STEP = 0.033


def free_flight_filter(params, step):
    """Return the detector's filter at its start: position, velocity and rates, [m] and [rad].

    Transition, input, process noise (acceleration held a step) and measurement noise are for a
    step [s]; the input is the acceleration of a free flight, the measurement position and rates.
    """
    kf = KalmanFilter(dim_x=9, dim_z=6, dim_u=3)
    kf.P = np.diag([1e-6] * 3 + [1.0] * 3 + [1.0] * 3)
    kf.H = np.zeros((6, 9))
    kf.H[[0, 1, 2, 3, 4, 5], [0, 1, 2, 6, 7, 8]] = 1.0
    kf.F, kf.B, kf.Q = np.eye(9), np.zeros((9, 3)), np.zeros((9, 9))
    sizes = (params.acceleration_xy, params.acceleration_xy, params.acceleration_z)
    turns = (params.tilt_acceleration, params.tilt_acceleration, params.yaw_acceleration)
    gain = np.array([0.5 * step * step, step])
    for i in range(3):
        kf.F[i, 3 + i] = step
        kf.B[[i, 3 + i], i] = gain
        kf.Q[np.ix_([i, 3 + i], [i, 3 + i])] = sizes[i] ** 2 * np.outer(gain, gain)
        kf.Q[6 + i, 6 + i] = (turns[i] * step) ** 2
    rate_noise = params.rate_noise * max(1.0, RATE_STEP / step)
    kf.R = np.diag([params.position_noise**2] * 3 + [rate_noise**2] * 3)
    return kf


@pytest.mark.slow
@pytest.mark.parametrize("rate", [30.0, 100.0])
@pytest.mark.parametrize("seed", range(5))
def test_compiled_filter_agrees_with_filterpy(rate, seed):
    params = DetectorParams(trigger="none")
    poses = flight(3.0, velocity=(0.7, 0.1, -0.1), seed=seed, rate=rate)
    poses = poses.pushed(2.0, (-0.5, 0.2, -0.3)).turned(2.0, (0.5, -0.3, 2.0))
    detector = CollisionDetector(params)
    memory = detector.memory
    kf = None
    for i, (t, position, attitude) in enumerate(
        zip(poses.t, poses.position, poses.attitude, strict=True)
    ):
        detector.update(float(t), position, attitude)
        assert not detector.refused
        if kf is None or t - poses.t[i - 1] > params.gap_max:
            kf = free_flight_filter(params, 1.0)
            kf.x[:3, 0] = position
            continue
        step, before = float(t - poses.t[i - 1]), poses.attitude[i - 1]
        model = free_flight_filter(params, step)
        kf.F, kf.B, kf.Q, kf.R = model.F, model.B, model.Q, model.R
        turn = np.array(rotation_vector(attitude, before))
        kf.predict(u=np.array([[*free_acceleration(before, attitude), 0.0]]).T)
        kf.update(np.array([[*position, *(turn / step)]]).T)
        state = np.concatenate([memory.position, memory.velocity, memory.rates])
        assert state == pytest.approx(kf.x[:, 0], rel=1e-12, abs=1e-12)
        for axis in range(3):
            block = kf.P[np.ix_([axis, 3 + axis], [axis, 3 + axis])]
            found = memory.covariance[axis]
            assert found == pytest.approx([block[0, 0], block[0, 1], block[1, 1]], rel=1e-9)
            assert memory.rate_variance[axis] == pytest.approx(kf.P[6 + axis, 6 + axis], rel=1e-9)
        residual = np.concatenate([memory.position_residual, memory.rate_residual])
        assert residual == pytest.approx(kf.y[:, 0], rel=1e-12, abs=1e-12)
        if memory.samples > 8:
            expected = float(kf.y[:, 0] @ kf.SI @ kf.y[:, 0])
            assert detector.statistic == pytest.approx(expected, rel=1e-9)
