"""From a film to the flap angle over time: scale, windows, and all windows together."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
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
    paper_angle,
)
from tombo_propeller.flap_video.disc import Disc, Frames, find_disc
from tombo_propeller.flap_video.disc_rim import Rim, find_rim
from tombo_propeller.flap_video.scale import (
    PixelScale,
    radius_sd_px,
    refit_with_reference_profile,
    rim_radius_m,
)


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


_LEAST_FRAMES = 8
_MOST_FRAMES = 500
_CHANCE = 1e-3
"""Probability of a scatter between windows below which the angle changes."""


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
    own = np.array([radius_sd_px(w.rim) / scale.pixels_per_m for w in windows])
    radii = np.array([w.radius for w in windows])
    weights = own**-2
    mean = float(weights @ radii / weights.sum())
    count = len(windows)
    scatter = float(weights @ (radii - mean) ** 2)
    steady = bool(chdtrc(max(count - 1, 1), scatter) > _CHANCE)
    spread = max(scatter / max(count - 1, 1), 1.0)
    chance = math.sqrt(spread / float(weights.sum()))
    k = int(np.argmin(own))
    common = math.sqrt(max(windows[k].radius_sd ** 2 - own[k] ** 2, 0.0))
    return mean, math.hypot(chance, common), steady
