"""How many pixels a metre has in the disc of the straight blades, and a rim in metres."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.blade_passes import resting_passes
from tombo_propeller.flap_video.camera_geometry import (
    BladeSpan,
    CameraPose,
    angle,
    apparent_radius,
    magnified,
)
from tombo_propeller.flap_video.disc import Frames, NothingMovesError, find_disc
from tombo_propeller.flap_video.disc_rim import Rim, find_rim, fit_rim

_FLOOR_PX = 0.015
"""Pixels that no fit is trusted beyond: interpolation, compression, the lens."""
_TIP_INSET = 0.0003
"""m from the tip to where its profile has fallen to half; matters only where a scale is given."""
_TIP_INSET_SD = 0.00025
_BENT = 0.0002
"""m by which a long tip's profile is misread where it is foreshortened, times 1 - cos(beta)."""


@dataclass(frozen=True)
class PixelScale:
    """Pixels per metre in the disc of the straight blades, or a disc of known flap."""

    pixels_per_m: float
    error: float
    """Share, one standard deviation."""
    source: str
    relative: bool
    """Whether the rim of the same propeller was measured: then the tip's shape cancels."""
    rim: Rim | None = None

    def __post_init__(self) -> None:
        if not 100.0 <= self.pixels_per_m <= 1e6:
            raise InputError(
                f"scale of {self.pixels_per_m / 1e3:g} pixels per mm; accepted: 0.1 to 1000"
            )
        if not 0.0 <= self.error < 0.2:
            raise InputError(f"error of the scale {self.error:g}; accepted: a share, 0 to 0.2")


def known_scale(pixels_per_m: float, error: float) -> PixelScale:
    """Take a scale that somebody has measured."""
    return PixelScale(pixels_per_m, error, "given", False)


def marked_scale(a: tuple[float, float], b: tuple[float, float], distance: float) -> PixelScale:
    """Take the scale from two marks in the disc's plane, `distance` [m] apart.

    A mark is taken to be known to half a pixel.

    Raises:
        InputError: marks that are too near for that.
    """
    pixels = math.hypot(a[0] - b[0], a[1] - b[1])
    if not (distance > 0.0 and math.isfinite(distance)) or not pixels > 10.0:
        raise InputError(
            f"marks {pixels:.1f} pixels and {distance * 1e3:g} mm apart; accepted: more than 10 "
            "pixels and 0 mm"
        )
    return PixelScale(pixels / distance, 0.5 * math.sqrt(2.0) / pixels, "marks", False)


def reference_scale(
    frames: Frames, beta: float, span: BladeSpan, view: CameraPose, spinning: Rim | None = None
) -> PixelScale:
    """Take the scale from frames of the same propeller, same camera, with a known flap [rad].

    Args:
        frames: slowly spinning, or at rest.
        beta: the flap in them.
        span: of the blade.
        view: where the camera is.
        spinning: a rim of the fast one; what is behind blades at rest is known from there.

    Raises:
        InputError: nothing to be measured in them.
    """
    seen = float(apparent_radius(np.array(beta), span, view))
    try:
        rim, how = find_rim(frames, find_disc(frames)), "reference, spinning"
        # Its profile is the one that counts: what remains is the radius' own error.
        rim = replace(rim, sd=fit_rim(rim.passes, rim.radius, rim.oval, like=rim.profile).sd)
    except NothingMovesError:
        if spinning is None:
            raise
        still = frames.astype(np.float32).mean(axis=0)
        passes = resting_passes(still, spinning.x, spinning.y, spinning.passes)
        first = spinning.radius * span.tip / seen
        profile = spinning.profile.seen_at(first, 1.0)
        rim = fit_rim(passes, first, spinning.oval, round_known=True, like=profile)
        how = "reference, at rest"
    error = radius_sd_px(rim) / rim.radius
    return PixelScale(rim.radius / seen, error, how, True, rim)


def refit_with_reference_profile(
    rim: Rim, scale: PixelScale, span: BladeSpan, view: CameraPose
) -> Rim:
    """Fit again with the reference's profile, so that what it gets wrong cancels."""
    if scale.rim is None:
        return rim
    for _ in range(2):
        radius, sd = rim_radius_m(rim, scale)
        flap = angle(radius, sd, span, view).best
        profile = scale.rim.profile.seen_at(
            rim.radius, math.cos(flap) * magnified(flap, span, view)
        )
        fit = fit_rim(rim.passes, rim.radius, rim.oval, like=profile)
        bent = _BENT * (1.0 - math.cos(flap)) * scale.pixels_per_m
        rim = replace(fit, x=rim.x, y=rim.y, sd=math.hypot(fit.sd, bent))
    return rim


def rim_radius_m(rim: Rim, scale: PixelScale) -> tuple[float, float]:
    """Return the disc's radius and its standard deviation [m]."""
    pixels, sd = rim.radius, radius_sd_px(rim)
    if scale.relative:  # a tilted camera shortens both alike
        radius = pixels / scale.pixels_per_m
        return radius, math.hypot(sd / scale.pixels_per_m, radius * scale.error)
    stretch = math.hypot(*rim.oval)
    if stretch > 3.0 * rim.oval_sd:
        pixels += stretch  # across the tilt nothing is shortened
    sd = math.hypot(sd, rim.oval_sd)
    radius = pixels / scale.pixels_per_m + _TIP_INSET
    parts = (sd / scale.pixels_per_m, radius * scale.error, _TIP_INSET_SD)
    return radius, math.sqrt(sum(part**2 for part in parts))


def radius_sd_px(rim: Rim) -> float:
    """Return the standard deviation [pixels] that a rim's radius is trusted to."""
    return math.hypot(rim.sd, _FLOOR_PX)
