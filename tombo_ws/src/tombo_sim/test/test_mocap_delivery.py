"""Motion capture in the kernel: captured in one tick, delivered in a later one."""

import numpy as np
import pytest
from kernel_flight import NOISE, TICK, capture_ticks, fly_kernel

RAGGED = {"mocap_latency": {"delay": 0.05, "jitter": 0.03}}
"""Jitter as long as the period: samples overtake each other."""


def delivered_rows(flight):
    ticks, rows = np.array(flight.delivered).T
    return ticks, rows


@pytest.mark.parametrize("delay", [0.0, 0.001, 0.0336, 0.110])
def test_a_sample_arrives_later_by_the_latency_and_keeps_its_stamp(delay):
    late = {"mocap_latency": {"delay": delay}}
    f = fly_kernel(late, seconds=1.0, mocap_noise=np.zeros((31, NOISE)))
    ticks, rows = delivered_rows(f)
    captured = f.mocap["stamp"][rows]
    assert rows.tolist() == list(range(rows.size)) and rows.size >= 26
    assert (captured == capture_ticks(1.0)[rows]).all()
    assert (ticks - captured == round(delay / TICK)).all()
    assert (f.mocap["arrives"][rows] == ticks).all()
    assert f.mocap["delivered"][rows].all()
    pending = f.mocap["delivered"][rows.max() + 1 : 30]
    assert not pending.any()


def test_a_sample_is_the_true_pose_at_its_capture():
    f = fly_kernel({"mocap_latency": {"delay": 0.02}}, seconds=1.0)
    at = f.mocap["stamp"][:30].astype(int)
    assert (f.mocap["position"][:30] == f["position"][at]).all()
    assert (f.mocap["attitude"][:30] == f["attitude"][at]).all()


def test_every_sample_is_delivered_once_whatever_overtakes():
    f = fly_kernel(RAGGED, seconds=3.0, seed=1)
    ticks, rows = delivered_rows(f)
    captured = f.mocap["stamp"][rows]
    assert len(set(rows)) == len(rows)
    assert (np.diff(ticks) >= 0).all()
    assert (ticks >= captured).all()
    assert (np.diff(captured) < 0.0).any()  # some did overtake
    assert len(rows) >= 85


def test_a_dropped_sample_never_arrives():
    f = fly_kernel({"mocap_dropouts": {"probability": 0.2, "duration": 0.1}}, seconds=5.0, seed=2)
    _, rows = delivered_rows(f)
    missing = sorted(set(range(150)) - set(rows))
    assert 20 < len(missing) < 130
    assert (f.mocap["arrives"][missing] == -1).all()
    assert not f.mocap["delivered"][missing].any()
    assert (np.diff(missing) == 1).any()  # gaps, not single samples only
