"""The flap angle of rendered films: with OpenCV, which the suite does not install."""

import math

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from camera_geometry import BladeSpan, CameraPose, apparent_radius  # noqa: E402
from disc import find_disc  # noqa: E402
from flap_angle import flap_angle  # noqa: E402

SPAN, SCALE, TURN = BladeSpan(0.1111, 0.035), 3300.0, 0.31


def film(radius, frames):
    """Draw two blades of a radius [m] that turn, each frame blurred over a part of its turn."""
    shots = []
    for k in range(frames):
        light = np.zeros((800, 800))
        for phi in k * TURN + np.linspace(0.0, 0.3 * TURN, 8):
            tip = SCALE * radius * np.array([math.cos(phi), math.sin(phi)])
            picture = np.full(light.shape, 220.0)
            ends = [tuple(np.round(16 * (400 + s * tip)).astype(int).tolist()) for s in (-1, 1)]
            cv2.line(picture, *ends, 60.0, 18, cv2.LINE_AA, 4)
            light += picture / 8.0
        shots.append(light.astype(np.uint8))
    return np.stack(shots)


@pytest.mark.parametrize("degrees", [12.0, 20.0, 30.0])
@pytest.mark.parametrize("view", [CameraPose(3.0), CameraPose(1.0, towards=False)])
def test_the_interval_of_a_rendered_film_has_the_flap(degrees, view):
    beta = math.radians(degrees)
    radius = float(apparent_radius(np.array(beta), SPAN, view))
    at_rest, disc = find_disc(film(SPAN.tip, 30)), find_disc(film(radius, 20))
    measured = flap_angle(disc, at_rest, SPAN, view)
    assert measured.low <= beta <= measured.high
    assert measured.high - measured.low < math.radians(8.0)


def test_straight_blades_are_no_number():
    disc = find_disc(film(SPAN.tip, 30))
    assert "at most" in flap_angle(disc, disc, SPAN, CameraPose(10.0, towards=False)).as_text()


def test_what_does_not_move_is_refused():
    with pytest.raises(ValueError, match="nothing moves"):
        find_disc(film(SPAN.tip, 1).repeat(10, axis=0))
