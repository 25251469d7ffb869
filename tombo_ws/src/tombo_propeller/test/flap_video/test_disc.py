"""The disc in combined frames, and pictures in which there is none."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from films import SMALL, shots

from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.disc import NothingMovesError, circle_of, find_disc, remove_flicker


def ring(n=90, x=100.0, y=80.0, r=50.0, noise=0.3, seed=0):
    rng = np.random.default_rng(seed)
    phi = np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)
    return np.column_stack([x + r * np.cos(phi), y + r * np.sin(phi)]) + noise * rng.normal(
        size=(n, 2)
    )


def test_the_circle_is_found_though_a_part_bulges():
    points = ring()
    points[10:22] += 0.2 * (points[10:22] - [100.0, 80.0])
    disc = circle_of(cv2.convexHull(points.astype(np.float32))[:, 0].astype(float))
    assert (disc.x, disc.y, disc.radius) == pytest.approx((100.0, 80.0, 50.0), abs=0.7)


SQUARE = np.array([[0, 0], [100, 0], [100, 60], [0, 60.0]])
LINE = np.array([[0, 0], [1, 1], [2, 2.0]])


@pytest.mark.parametrize("points", [SQUARE, LINE, np.zeros((2, 2))])
def test_what_is_not_round_is_refused(points):
    with pytest.raises(InputError, match="not round"):
        circle_of(points)


@pytest.mark.slow
@pytest.mark.parametrize("speed, exposure", [(210.0, 0.1), (400.0, 1.0), (520.0, 0.5)])
def test_the_disc_is_found_to_some_pixels(speed, exposure):
    scene = replace(SMALL, speed=speed, exposure=exposure)
    disc = find_disc(shots(scene))
    assert disc.radius == pytest.approx(0.1111 * math.cos(0.0) * scene.scale, rel=0.03)
    assert (disc.x, disc.y) == pytest.approx((199.5 + 6.0, 199.5 - 4.0), abs=2.0)


@pytest.mark.slow
def test_flicker_is_taken_out():
    frames = shots(replace(SMALL, flicker=0.1, noise=0.0))
    corner = [f[:30, :30].mean() for f in remove_flicker(frames)]
    assert np.ptp([f[:30, :30].mean() for f in frames]) > 5.0
    assert np.ptp(corner) < 0.6


def test_frames_that_show_nothing_are_refused():
    with pytest.raises(InputError, match="black"):
        find_disc(np.zeros((10, 200, 200), np.uint8))
    with pytest.raises(InputError, match="saturated"):
        find_disc(np.full((10, 200, 200), 255, np.uint8))
    noise = np.random.default_rng(0).normal(120.0, 3.0, (10, 200, 200)).astype(np.uint8)
    with pytest.raises(NothingMovesError, match="nothing moves"):
        find_disc(noise)


def test_noise_as_strong_as_a_blade_is_no_propeller():
    noise = np.random.default_rng(0).uniform(0.0, 255.0, (10, 200, 200)).astype(np.uint8)
    with pytest.raises(InputError):
        find_disc(noise)


@pytest.mark.slow
def test_two_propellers_are_refused():
    one = shots(SMALL)
    with pytest.raises(InputError, match=r"outside of the disc|not round"):
        find_disc(np.concatenate([one, shots(replace(SMALL, phase=1.0))], axis=2))


def test_something_else_that_moves_is_refused():
    frames = np.full((10, 300, 300), 150, np.uint8)
    for k, frame in enumerate(frames):
        frame[100:140, 10 + 25 * k : 50 + 25 * k] = 20
    with pytest.raises(InputError, match="not round"):
        find_disc(frames)
