"""Rendered films with a known flap come out with it, whatever blur, light and view."""

import math
from dataclasses import replace

import numpy as np
import pytest
from films import SMALL, SPAN, measured, reference, shots

from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.camera_geometry import CameraPose
from tombo_propeller.flap_video.disc import find_disc
from tombo_propeller.flap_video.disc_rim import find_rim
from tombo_propeller.flap_video.measure import (
    known_scale,
    marked_scale,
    measure,
    reference_scale,
    spans_of,
)

HARD = [
    {"beta": 8.0, "speed": 210.0, "exposure": 0.15, "gradient": 0.4, "clutter": 0.2},
    {"beta": 15.0, "speed": 520.0, "exposure": 1.0, "flicker": 0.05, "noise": 0.02},
    {
        "beta": 30.0,
        "speed": 350.0,
        "exposure": 0.6,
        "tilt": 0.08,
        "twist": 0.15,
        "tip_rounding": 0.007,
    },
    {
        "beta": 20.0,
        "speed": 300.0,
        "exposure": 0.4,
        "blade_light": 0.9,
        "ground_light": 0.3,
        "arm": False,
    },
]


def degrees(angle):
    return math.degrees(angle)


@pytest.mark.slow
@pytest.mark.parametrize("changes", HARD, ids=str)
def test_the_flap_comes_out_within_half_a_degree(changes):
    truth = changes["beta"]
    measurement = measured(replace(SMALL, **changes | {"beta": math.radians(truth)}), windows=2)
    assert degrees(measurement.overall.best) == pytest.approx(truth, abs=0.5)
    assert measurement.overall.resolved and measurement.steady
    assert measurement.overall.low <= math.radians(truth) <= measurement.overall.high
    assert all(w.speed == pytest.approx(changes["speed"], rel=0.02) for w in measurement.windows)


@pytest.mark.slow
def test_four_degrees_within_one_and_a_half():
    measurement = measured(replace(SMALL, beta=math.radians(4.0), camera_height=10.0), windows=2)
    assert degrees(measurement.overall.best) == pytest.approx(4.0, abs=1.5)
    assert measurement.overall.low <= math.radians(4.0) <= measurement.overall.high


@pytest.mark.slow
def test_a_straight_propeller_is_at_most_some_degrees():
    measurement = measured(replace(SMALL, beta=0.0))
    assert not measurement.overall.resolved
    assert measurement.overall.low == 0.0 and 1.0 < degrees(measurement.overall.high) < 6.0


@pytest.mark.slow
def test_the_rim_does_not_depend_on_exposure_or_speed():
    radii = []
    for speed, exposure in [(210.0, 0.1), (350.0, 1.0), (520.0, 0.6)]:
        frames = shots(replace(SMALL, beta=0.2, speed=speed, exposure=exposure, noise=0.004))
        radii.append(find_rim(frames, find_disc(frames)).radius)
    assert np.ptp(radii) < 0.2  # pixels; the hull's circle moves by more than one


@pytest.mark.slow
def test_from_below_small_angles_are_resolved_that_from_above_are_not():
    near = replace(SMALL, beta=math.radians(3.0), camera_height=1.0)
    assert not measured(near).overall.resolved
    below = measured(replace(near, towards=False)).overall
    assert below.resolved
    assert degrees(below.best) == pytest.approx(3.0, abs=0.4)


@pytest.mark.slow
def test_a_camera_that_is_near_misleads_who_takes_it_for_far():
    scene = replace(SMALL, beta=math.radians(20.0), camera_height=1.0)
    assert degrees(measured(scene).overall.best) == pytest.approx(20.0, abs=0.5)
    assert degrees(measured(scene, view=CameraPose()).overall.best) < 14.0


@pytest.mark.slow
def test_a_reference_at_rest_gives_the_same_scale():
    scene = replace(SMALL, beta=math.radians(20.0))
    frames = shots(scene)
    spinning = find_rim(frames, find_disc(frames))
    still = reference(scene, speed=0.0, phase=0.8)[:4]
    at_rest = reference_scale(still, 0.0, SPAN, CameraPose(8.0), spinning)
    slowly = reference_scale(reference(scene), 0.0, SPAN, CameraPose(8.0))
    assert at_rest.source == "reference, at rest"
    assert at_rest.pixels_per_m == pytest.approx(slowly.pixels_per_m, rel=1.5e-3)


@pytest.mark.slow
def test_a_tilted_camera_is_noticed():
    frames = shots(replace(SMALL, beta=0.3, tilt=0.15))
    rim = find_rim(frames, find_disc(frames))
    assert rim.tilt == pytest.approx(0.15, abs=0.03)


@pytest.mark.slow
def test_a_given_scale_knows_its_limits():
    scene = replace(SMALL, beta=math.radians(25.0))
    measurement = measured(scene, scale=known_scale(scene.scale, 0.002)).overall
    assert measurement.low <= scene.beta <= measurement.high
    assert degrees(measurement.best) == pytest.approx(25.0, abs=1.0)
    small = measured(replace(scene, beta=math.radians(3.0)), scale=known_scale(scene.scale, 0.002))
    assert not small.overall.resolved


def test_marks_give_a_scale():
    assert marked_scale((10.0, 10.0), (310.0, 410.0), 0.2).pixels_per_m == pytest.approx(2500.0)
    for marks in [((0.0, 0.0), (1.0, 1.0), 0.1), ((0.0, 0.0), (100.0, 0.0), 0.0)]:
        with pytest.raises(InputError, match="marks"):
            marked_scale(*marks)


@pytest.mark.parametrize("scale", [0.0, -2500.0, math.nan, 1e9, 5.0])
def test_a_scale_that_is_nonsense_is_refused(scale):
    with pytest.raises(InputError, match="scale"):
        known_scale(scale, 0.01)


@pytest.mark.slow
def test_a_scale_that_makes_it_another_propeller_is_refused():
    with pytest.raises(InputError, match="radius by the scale"):
        measured(SMALL, scale=known_scale(600.0, 0.002))


@pytest.mark.slow
def test_a_flap_that_changes_is_not_averaged():
    class Video:
        path, fps = "changing", 960.0

        def parts(self, spans):
            for k, (first, _) in enumerate(spans):
                yield first, shots(replace(SMALL, beta=math.radians(10.0 + 8.0 * k)))

    scale = reference_scale(reference(SMALL), 0.0, SPAN, CameraPose(8.0))
    measurement = measure(Video(), [(0, 10), (10, 20)], lambda rim: scale, SPAN, CameraPose(8.0))
    assert not measurement.steady
    assert [degrees(w.angle.best) for w in measurement.windows] == pytest.approx(
        [10.0, 18.0], abs=0.5
    )


def test_windows_lie_evenly_over_the_film():
    assert spans_of(100, 10, 3) == [(0, 10), (40, 50), (90, 100)] or len(spans_of(100, 10, 3)) == 3
    assert spans_of(35, 10, 60) == [(0, 10), (10, 20), (20, 30)]
    for bad in [(1, 10, 5), (100, 2, 5), (100, 10, 0)]:
        with pytest.raises(InputError):
            spans_of(*bad)
