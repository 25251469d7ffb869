"""The renderer: physics that the measurement does not know from it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from films import SMALL, shots

from tombo_propeller.flap_video.synthetic_video import SyntheticVideo

pytestmark = pytest.mark.slow

BARE = replace(SMALL, clutter=0.0, gradient=0.0, arm=False, noise=0.0, defocus=0.0, tilt=0.0,
               off_centre=(0.0, 0.0), speed=0.0, exposure=0.0, phase=0.0)  # fmt: skip


def reach(scene):
    """Return how far right of the hub a blade at rest is seen, in pixels."""
    frame = shots(scene)[0].astype(float)
    row = frame[195:205].min(axis=0)
    ground = np.median(row[390:])
    dark = np.flatnonzero(row < ground - 8.0)
    return dark.max() + 0.5 - 0.5 * (scene.width - 1)


@pytest.mark.parametrize("beta", [0.0, 15.0, 30.0])
@pytest.mark.parametrize("height, towards", [(0.6, True), (8.0, True), (0.6, False)])
def test_a_flapped_tip_is_where_a_pinhole_puts_it(beta, height, towards):
    b = math.radians(beta)
    scene = replace(BARE, beta=b, camera_height=height, towards=towards, tip_rounding=0.0011)
    z = (1 if towards else -1) * 0.0761 * math.sin(b)
    wanted = (0.035 + 0.0761 * math.cos(b)) / (1.0 - z / height) * scene.scale
    assert reach(scene) == pytest.approx(wanted, abs=1.0)


def test_motion_blur_moves_darkness_along_the_circle_and_loses_none():
    sums = []
    for exposure in (0.05, 0.5, 1.0):
        scene = replace(BARE, speed=500.0, exposure=exposure, phase=1.0)
        blade = 1.0 - shots(scene)[0] / np.median(shots(scene)[0])
        sums.append(blade.sum())
    assert sums == pytest.approx([sums[0]] * 3, rel=0.005)


def test_blades_turn_by_speed_over_frame_rate():
    scene = replace(BARE, speed=300.0, exposure=0.1)
    first = SyntheticVideo(scene).frame(0)
    turned = SyntheticVideo(replace(scene, phase=300.0 / 960.0 * 3)).frame(0)
    assert (SyntheticVideo(scene).frame(3) == turned).all()
    assert (first != turned).any()


def test_a_seed_is_a_film():
    noisy = replace(SMALL, noise=0.02)
    assert (shots(noisy, 2, 5) == np.stack(list(SyntheticVideo(noisy, 5).frames(2)))).all()
    assert (shots(noisy, 2, 5) != shots(noisy, 2, 6)).any()
