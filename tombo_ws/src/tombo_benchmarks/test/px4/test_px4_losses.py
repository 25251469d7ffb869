"""Losses in hover over the simulated PX4: every flight ends on the ground, disarmed, for good."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tombo_benchmarks.px4.losses import LOSSES, Loss, LossResult, fly_loss, judged_track

_FLOWN = ("poses stop for 30 s", "poses of another body", "bridge stopped for 20 s")
"""The others, and the real PX4: `make test-px4 ARGS=--losses`."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "loss", [loss for loss in LOSSES if loss.name in _FLOWN], ids=lambda loss: str(loss.name)
)
def test_a_loss_ends_on_the_ground(loss: Loss, tmp_path: Path):
    result = fly_loss(loss, 0, None, tmp_path / "px4")

    assert result.ended, result
    assert result.down_s is not None and result.down_s < 6.0
    assert result.off_s is not None and result.off_s < 10.0
    assert result.drift_m < 1.5
    assert [name for _, name in result.modes] == ["offboard", "land", "disarmed"]


def judged(height: np.ndarray, armed: np.ndarray) -> LossResult:
    seconds = np.arange(len(height)) * 1e-3
    zero = np.zeros(len(height))
    track = np.column_stack((seconds, height, zero, zero, armed))
    return LossResult("x", 0, True, **judged_track(track))


def test_only_what_stays_on_the_ground_has_ended():
    down = np.concatenate((np.linspace(2.0, 0.0, 3000), np.zeros(3000)))
    on, off = np.ones(4500), np.zeros(1500)
    assert judged(down, np.concatenate((on, off))).ended
    assert not judged(down, np.ones(6000)).ended
    again = down.copy()
    again[5000:] = 0.3
    assert judged(again, np.concatenate((on, off))).again
    armed_again = np.concatenate((on, off))
    armed_again[-100:] = 1.0
    assert judged(down, armed_again).again
    assert judged(np.full(6000, 2.0), np.ones(6000)).down_s is None
