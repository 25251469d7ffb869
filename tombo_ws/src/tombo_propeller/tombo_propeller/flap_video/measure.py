"""From a film to the flap angle over time: scale, windows, and all windows together.

The scale is how many pixels a metre has in the disc of the straight blades.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.special import chdtrc

from tombo_dynamics.errors import InputError
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_propeller.flap_video.camera_geometry import (
    BladeSpan,
    CameraPose,
    FlapAngle,
    angle,
    apparent_radius,
    magnified,
    paper_angle,
)
from tombo_propeller.flap_video.disc import Disc, Frames, NothingMovesError, find_disc
from tombo_propeller.flap_video.disc_rim import Rim, find_rim, fit_rim, resting_passes

_FLOOR_PX = 0.015
"""Pixels that no fit is trusted beyond: interpolation, compression, the lens."""
_TIP_INSET = 0.0003
"""m from the tip to where its profile has fallen to half; matters only where a scale is given."""
_TIP_INSET_SD = 0.00025
_BENT = 0.0002
"""m by which a long tip's profile is misread where it is foreshortened, times 1 - cos(beta)."""
_LEAST_FRAMES = 8
_MOST_FRAMES = 500
_CHANCE = 1e-3
"""Probability of a scatter between windows below which the angle changes."""


class Film(Protocol):
    """A film on disk, or a rendered one."""

    @property
    def path(self) -> Path:
        """Its name."""

    @property
    def fps(self) -> float:
        """Frames per second."""

    def parts(self, spans: list[tuple[int, int]]) -> Iterator[tuple[int, Frames]]:
        """Yield (first frame, frames) of spans [first, behind)."""


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


@dataclass(frozen=True)
class VideoWindow:
    """Some frames combined."""

    first: int
    frames: int
    time: float
    """s, middle of the window."""
    speed: float
    """rad/s, from how far two blades turn from frame to frame."""
    disc: Disc
    rim: Rim
    radius: float
    """m, as the scale of the straight blades' disc has it."""
    radius_sd: float
    angle: FlapAngle
    paper: float
    """rad, the paper's formula on the hull's circle; NaN where it has none."""


@dataclass(frozen=True)
class FlapMeasurement:
    """The flap angle over a film."""

    windows: tuple[VideoWindow, ...]
    picture: Frames
    """The first measured window's frames."""
    skipped: tuple[str, ...]
    """Why a window gave nothing."""
    scale: PixelScale
    span: BladeSpan
    view: CameraPose
    overall: FlapAngle
    """Of all windows together, which means something if `steady`."""
    radius: float
    radius_sd: float
    steady: bool


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


def _scaled(
    disc: Disc,
    rim: Rim,
    first: int,
    count: int,
    fps: float,
    scale: PixelScale,
    span: BladeSpan,
    view: CameraPose,
) -> VideoWindow:
    rim = refit_with_reference_profile(rim, scale, span, view)
    radius, sd = rim_radius_m(rim, scale)
    if not span.nodus < radius < 2.0 * span.tip:
        raise InputError(
            f"a disc of {radius * 1e3:.1f} mm radius by the scale ({scale.source}); accepted: one "
            f"between nodus, {span.nodus * 1e3:g} mm, and twice the tip's {span.tip * 1e3:g} mm"
        )
    return VideoWindow(
        first, count, (first + 0.5 * (count - 1)) / fps, rim.passes.rotation_per_frame * fps, disc,
        rim,
        radius, sd, angle(radius, sd, span, view),
        paper_angle(disc.radius / scale.pixels_per_m, span),
    )  # fmt: skip


def spans_of(count: int, window: int, most: int, begin: int = 0) -> list[tuple[int, int]]:
    """Return spans of `window` frames, at most `most` of them, evenly over a film.

    Raises:
        InputError: too few frames, or a nonsensical choice.
    """
    if not _LEAST_FRAMES <= window <= _MOST_FRAMES:
        raise InputError(
            f"windows of {window} frames; accepted: {_LEAST_FRAMES} to {_MOST_FRAMES}"
        )
    if most < 1:
        raise InputError(f"{most} windows; accepted: 1 or more")
    whole = (count - begin) // window
    if whole < 1:
        raise InputError(
            f"{max(count - begin, 0)} frames; accepted: {window} or more, as many as a window"
        )
    chosen = np.unique(np.linspace(0, whole - 1, min(most, whole)).round().astype(int))
    return [(begin + int(k) * window, begin + (int(k) + 1) * window) for k in chosen]


def measure(
    film: Film,
    spans: list[tuple[int, int]],
    scale_of: Callable[[Rim], PixelScale],
    span: BladeSpan,
    view: CameraPose,
    on_progress: ProgressCallback = no_progress,
) -> FlapMeasurement:
    """Measure windows of a film.

    Args:
        film: the film.
        spans: windows, as of `spans_of`.
        scale_of: gives the scale; it is asked once, with the rim of the first good window.
        span: of the blade.
        view: where the camera is.
        on_progress: called with the share that is done.

    Raises:
        InputError: no window can be measured, with the reason of the first; or no scale.
    """
    rims: list[tuple[int, int, Disc, Rim]] = []
    skipped: list[str] = []
    reason: InputError | None = None
    picture: Frames | None = None
    for k, (first, frames) in enumerate(film.parts(spans)):
        on_progress(f"frames {first} to {first + len(frames) - 1}", k / len(spans))
        try:
            if len(frames) < _LEAST_FRAMES:
                raise InputError(f"{len(frames)} frames; accepted: {_LEAST_FRAMES} or more")
            disc = find_disc(frames)
            rims.append((first, len(frames), disc, find_rim(frames, disc)))
            picture = frames if picture is None else picture
        except InputError as error:
            reason = reason or error
            skipped.append(f"frames {first} to {first + len(frames) - 1}: {error}")
    if picture is None:
        raise InputError(f"'{film.path}': {reason or 'no frames could be read'}")
    scale = scale_of(rims[0][3])
    windows = [
        _scaled(disc, rim, first, count, film.fps, scale, span, view)
        for first, count, disc, rim in rims
    ]
    radius, sd, steady = _together(windows, scale)
    return FlapMeasurement(
        tuple(windows), picture, tuple(skipped), scale, span, view,
        angle(radius, sd, span, view), radius, sd, steady,
    )  # fmt: skip


def _together(windows: list[VideoWindow], scale: PixelScale) -> tuple[float, float, bool]:
    """Return radius, standard deviation [m], and whether the windows agree."""
    sds = np.array([radius_sd_px(w.rim) / scale.pixels_per_m for w in windows])
    radii = np.array([w.radius for w in windows])
    weights = sds**-2
    mean = float(weights @ radii / weights.sum())
    count = len(windows)
    scatter = float(weights @ (radii - mean) ** 2)
    steady = bool(chdtrc(max(count - 1, 1), scatter) > _CHANCE)
    spread = max(scatter / max(count - 1, 1), 1.0)
    chance = math.sqrt(spread / float(weights.sum()))
    k = int(np.argmin(sds))
    common = math.sqrt(max(windows[k].radius_sd ** 2 - sds[k] ** 2, 0.0))
    return mean, math.hypot(chance, common), steady
