"""Losses in hover over the simulated PX4: every flight ends on the ground, disarmed, for good."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tombo_benchmarks.px4.lockstep_px4 import Px4Setup
from tombo_benchmarks.px4.losses import LOSSES, Loss, fly_loss, track_figures

_FAST_LOSSES = ("poses stop for 30 s", "poses of another body", "bridge stopped for 20 s")
"""The others, and the real PX4: `make test-px4 ARGS=--losses`."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "loss", [loss for loss in LOSSES if loss.name in _FAST_LOSSES], ids=lambda loss: str(loss.name)
)
def test_a_loss_ends_on_the_ground(loss: Loss, tmp_path: Path):
    row = fly_loss(Px4Setup(None, tmp_path / "px4"), loss)
    assert row["ended"], row
    assert row["down_s"] < 6.0 and row["off_s"] < 10.0 and row["drift_m"] < 1.5
    assert [name for _, name in row["modes"]] == ["offboard", "land", "disarmed"]


def track_of(height: np.ndarray, armed: np.ndarray) -> dict[str, Any]:
    seconds = np.arange(len(height)) * 1e-3
    return track_figures(np.column_stack((seconds, height, np.zeros(len(height)), armed)))


def test_only_what_stays_on_the_ground_has_ended():
    down = np.concatenate((np.linspace(2.0, 0.0, 3000), np.zeros(3000)))
    on, off = np.ones(4500), np.zeros(1500)
    assert track_of(down, np.concatenate((on, off)))["ended"]
    assert not track_of(down, np.ones(6000))["ended"]
    again = down.copy()
    again[5000:] = 0.3
    assert track_of(again, np.concatenate((on, off)))["again"]
    armed_again = np.concatenate((on, off))
    armed_again[-100:] = 1.0
    assert track_of(down, armed_again)["again"]
    assert track_of(np.full(6000, 2.0), np.ones(6000))["down_s"] is None
