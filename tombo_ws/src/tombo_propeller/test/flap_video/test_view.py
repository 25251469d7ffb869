"""What a camera sees of a flapped propeller, and which angles an interval holds."""

import math

import numpy as np
import pytest
from films import SPAN
from hypothesis import given
from hypothesis import strategies as st

from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.camera_geometry import (
    BladeSpan,
    CameraPose,
    ambiguous_angle_limit,
    angle,
    apparent_radius,
    paper_angle,
)


def deg(x):
    return math.degrees(x)


def projected(beta, height, up):
    """A pinhole at `height` above the hub, by similar triangles on the tip's own coordinates."""
    wing = SPAN.tip - SPAN.nodus
    x, z = SPAN.nodus + wing * math.cos(beta), up * wing * math.sin(beta)
    return x * height / (height - z)


@pytest.mark.parametrize("up", [1, -1])
@pytest.mark.parametrize("height", [0.4, 1.0, 7.0])
@pytest.mark.parametrize("beta", [0.0, 4.0, 17.0, 30.0])
def test_the_disc_is_that_of_a_pinhole_camera(beta, height, up):
    b = math.radians(beta)
    seen = apparent_radius(b, SPAN, CameraPose(height, up > 0))
    assert seen == pytest.approx(projected(b, height, up))


@given(st.floats(0.2, 60.0))
def test_far_away_the_papers_formula_holds_and_near_it_does_not(beta):
    b = math.radians(beta)
    assert paper_angle(float(apparent_radius(b, SPAN, CameraPose())), SPAN) == pytest.approx(
        b, abs=1e-6
    )
    near = paper_angle(float(apparent_radius(b, SPAN, CameraPose(1.0))), SPAN)
    assert math.isnan(near) or near < b


def test_seen_from_one_metre_a_flap_of_twelve_degrees_keeps_the_disc_size():
    blind = ambiguous_angle_limit(SPAN, CameraPose(1.0))
    assert apparent_radius(blind, SPAN, CameraPose(1.0)) == pytest.approx(SPAN.tip, rel=1e-4)
    assert deg(blind) == pytest.approx(2.0 * deg(math.atan(SPAN.tip / 1.0)), abs=0.3)
    assert (
        ambiguous_angle_limit(SPAN, CameraPose(1.0, towards=False))
        == ambiguous_angle_limit(SPAN, CameraPose())
        == 0.0
    )


@given(st.floats(0.0, 70.0), st.floats(1e-6, 1e-4), st.floats(-1.5, 1.5), st.floats(0.4, 20.0))
def test_the_interval_holds_the_truth_for_usual_noise(beta, sd, z, height):
    b, view = math.radians(beta), CameraPose(height)
    radius = float(apparent_radius(b, SPAN, view)) + z * sd
    flap = angle(radius, sd, SPAN, view)
    assert any(low - 2e-4 <= b <= high + 2e-4 for low, high in flap.pieces)
    assert flap.low <= flap.best <= flap.high


def test_the_interval_grows_as_one_over_the_sine():
    sd = 5e-6
    for beta in (10.0, 20.0, 40.0):
        b = math.radians(beta)
        flap = angle(float(apparent_radius(b, SPAN, CameraPose())), sd, SPAN, CameraPose())
        wanted = 2.0 * 1.96 * sd / ((SPAN.tip - SPAN.nodus) * math.sin(b))
        assert flap.high - flap.low == pytest.approx(wanted, rel=0.08, abs=3e-4)


def test_what_the_diameter_cannot_resolve_is_no_number():
    flap = angle(SPAN.tip, 5e-5, SPAN, CameraPose())
    assert not flap.resolved and flap.low == 0.0
    assert "at most" in flap.as_text() and "2.9 deg" in flap.as_text()
    twins = angle(
        float(apparent_radius(math.radians(10.0), SPAN, CameraPose(1.0))),
        1e-5,
        SPAN,
        CameraPose(1.0),
    )
    assert len(twins.pieces) == 2 and not twins.resolved
    assert " or " in twins.as_text()


def test_a_disc_too_large_for_any_flap_is_strange():
    flap = angle(SPAN.tip + 1e-3, 5e-5, SPAN, CameraPose())
    assert flap.inconsistent and "no angle" in flap.as_text()


def test_a_height_that_is_hardly_known_widens_the_interval():
    radius = float(apparent_radius(math.radians(20.0), SPAN, CameraPose(1.0)))
    sharp = angle(radius, 1e-5, SPAN, CameraPose(1.0, height_error=0.0))
    vague = angle(radius, 1e-5, SPAN, CameraPose(1.0, height_error=0.05))
    assert vague.high - vague.low > 5.0 * (sharp.high - sharp.low)


@pytest.mark.parametrize("tip, nodus", [(0.03, 0.035), (0.1, 0.1), (0.1, 0.0), (math.nan, 0.03)])
def test_a_span_that_is_none_is_refused(tip, nodus):
    with pytest.raises(InputError, match="nodus < tip"):
        BladeSpan(tip, nodus)


@pytest.mark.parametrize("radius, sd", [(math.nan, 1e-4), (-1.0, 1e-4), (0.1, 0.0), (0.1, np.inf)])
def test_a_radius_that_is_none_is_refused(radius, sd):
    with pytest.raises(InputError, match="disc radius"):
        angle(radius, sd, SPAN, CameraPose())


@pytest.mark.parametrize("height", [0.0, -1.0, math.nan])
def test_a_camera_must_be_somewhere(height):
    with pytest.raises(InputError, match="camera height"):
        CameraPose(height)


@pytest.mark.parametrize("error", [-0.01, 0.5, math.nan])
def test_an_error_of_the_camera_height_that_is_no_small_share_is_refused(error):
    with pytest.raises(InputError, match="error of the camera height"):
        CameraPose(1.0, height_error=error)
