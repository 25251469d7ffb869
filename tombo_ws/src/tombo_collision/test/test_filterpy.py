"""The compiled filter is filterpy's: same state, covariance and statistic to 1e-12."""

import numpy as np
import pytest
from pose_bench import flight

from core_calls import CollisionDetector
from tombo_collision.detector_core import DetectorCore
from tombo_collision.params import DetectorParams
from tombo_collision.reference_filter import ReferenceFilter, reference_statistics
from tombo_dynamics.messages import Pose


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "seed"), [(30.0, 0), (30.0, 1), (100.0, 2)])
def test_compiled_filter_agrees_with_filterpy(rate, seed):
    params = DetectorParams(trigger="none")
    poses = flight(3.0, velocity=(0.7, 0.1, -0.1), seed=seed, rate=rate)
    poses = poses.pushed(2.0, (-0.5, 0.2, -0.3)).rotate(2.0, (0.5, -0.3, 2.0))
    detector = CollisionDetector(params)
    memory = detector.memory
    reference = ReferenceFilter()
    kf = reference.filter
    settled = 0
    for t, position, attitude in zip(poses.t, poses.position, poses.attitude, strict=True):
        detector.update(float(t), position, attitude)
        assert not detector.refused
        reference.follow(memory, params)
        if memory.samples == 0:
            continue
        state = np.concatenate([memory.position, memory.velocity, memory.rates])
        assert state == pytest.approx(kf.x[:, 0], rel=1e-12, abs=1e-12)
        for axis in range(3):
            block = kf.P[np.ix_([axis, 3 + axis], [axis, 3 + axis])]
            covariance = memory.covariance[axis]
            assert covariance == pytest.approx([block[0, 0], block[0, 1], block[1, 1]], rel=1e-9)
            assert memory.rate_variance[axis] == pytest.approx(kf.P[6 + axis, 6 + axis], rel=1e-9)
        residual = np.concatenate([memory.position_residual, memory.rate_residual])
        assert residual == pytest.approx(kf.y[:, 0], rel=1e-12, abs=1e-12)
        assert detector.statistic == pytest.approx(reference.statistic, rel=1e-9)
        settled += reference.statistic > 0.0
    assert settled > rate


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["none", "gap", "jump", "clock", "strike", "refused"])
def test_filterpy_follows_the_detector_through_faults(fault):
    """Restarts of the detector's filter, and refused poses: filterpy's alike."""
    params = DetectorParams()
    poses = flight(4.0, velocity=(0.7, 0.1, -0.1), seed=3, rate=30.0)
    if fault == "strike":
        poses = poses.pushed(2.0, (-1.5, 0.2, -0.3)).rotate(2.0, (0.5, -0.3, 6.0))
    t, position = poses.t.copy(), poses.position.copy()
    later = t > 2.0
    if fault == "gap":
        t[later] += 1.0
    elif fault == "clock":
        t[later] -= 0.7
    elif fault == "jump":
        position[later] += 2.0
    elif fault == "refused":
        position[np.flatnonzero(later)[:2]] = np.nan
    stamps = 10_000_000_000 + np.rint(1e9 * t).astype(np.int64)
    messages = [
        Pose(int(stamp), "map", x, attitude)
        for stamp, x, attitude in zip(stamps, position, poses.attitude, strict=True)
    ]
    arrivals = stamps + 5_000_000
    core = DetectorCore(params)
    published = []
    for message, arrival in zip(messages, arrivals.tolist(), strict=True):
        core.on("/mocap/pose", message, arrival)
        published += [m.statistic for name, m in core.step(arrival) if name == "/detector/status"]
    statistics = reference_statistics(arrivals, messages, params)
    assert statistics == pytest.approx(published, rel=1e-9)
    assert sum(value > 0.0 for value in published) > 30
