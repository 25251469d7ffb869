"""The paper's measurement: frames combined, so that the blades fill a disc; its hull; its circle.

It finds the disc to a pixel or two. Its error depends on speed and exposure, because a tip covers
a point of the rim for a small share of the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Frames = NDArray[np.uint8]
"""(frames, height, width), grey."""

_LEAST_SWING = 8.0
"""Grey levels by which a blade must differ from the background."""
_QUIET = 3.0
"""Swing of a moving thing in swings of what stands still."""
_SECOND = 0.2
"""Area of a moving thing, in the largest one's, from which on it belongs to the picture."""
_OUTSIDE = 0.05
"""Share of what moves that may be outside of the disc."""
_BINS = 180
_TRIES = 400
_ROUND = 0.006
"""Share of the radius by which a point of the hull may miss the circle."""
_LEAST_ARC = 0.2
"""Share of the hull's directions that must lie on the circle."""


@dataclass(frozen=True)
class Disc:
    """The circle that the blades fill [pixels]."""

    x: float
    y: float
    radius: float
    hull: Array
    """Corners of the convex hull, (n, 2)."""


def pixel_range(frames: Frames) -> NDArray[np.float32]:
    """Return by how much each pixel changes over the frames, noise smoothed away."""
    least: Any = None
    most: Any = None
    for frame in remove_flicker(frames):
        smooth = cv2.GaussianBlur(frame, (5, 5), 0)
        least = smooth if least is None else np.minimum(least, smooth)
        most = smooth if most is None else np.maximum(most, smooth)
    return np.asarray(most - least, dtype=np.float32)


def remove_flicker(frames: Frames) -> list[NDArray[np.float32]]:
    """Return the frames with the lamps' flicker taken out, as most of a picture stands still."""
    coarse = frames[:, ::4, ::4].astype(np.float32)
    usual = np.median(coarse, axis=0)
    lit = (usual > 10.0) & (usual < 245.0)
    if lit.sum() < 100:
        return [frame.astype(np.float32) for frame in frames]
    gains = np.median(coarse[:, lit] / usual[lit], axis=1)
    return [f.astype(np.float32) / max(g, 0.05) for f, g in zip(frames, gains, strict=True)]


def find_disc(frames: Frames) -> Disc:
    """Find the one spinning propeller in a few frames.

    Raises:
        ValueError: black or saturated frames, nothing large that moves, several things that
            move, or what moves is not round.
    """
    _refuse_unlit(frames)
    swing = pixel_range(frames)
    still = float(np.percentile(swing, 10.0))
    strong = float(np.percentile(swing, 99.5))
    floor = max(_QUIET * still, 3.0, 0.05 * strong)
    if strong < max(_LEAST_SWING, 2.0 * floor):
        raise ValueError(
            f"nothing moves by more than {strong:.0f} grey levels (noise {still:.1f}); accepted: "
            "frames with a spinning propeller that contrasts with the background"
        )
    moving: Any = (swing > floor).astype(np.uint8)
    size = max(3, round(0.01 * min(swing.shape)) | 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    moving = cv2.morphologyEx(moving, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    joined = cv2.morphologyEx(moving, cv2.MORPH_CLOSE, kernel)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(joined)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < 0.005 * swing.size:
        raise ValueError(
            "nothing large moves; accepted: frames in which a spinning propeller fills a good part"
        )
    large = np.isin(labels, 1 + np.flatnonzero(areas > _SECOND * areas.max()))
    outlines, _ = cv2.findContours(
        large.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    outline: Any = np.concatenate(outlines)
    hull: Any = cv2.convexHull(outline)[:, 0, :].astype(float)
    disc = circle_of(hull)
    y, x = np.nonzero(large)
    outside = float(np.mean(np.hypot(x - disc.x, y - disc.y) > 1.03 * disc.radius + 2.0))
    if outside > _OUTSIDE:
        raise ValueError(
            f"{100 * outside:.0f} % of what moves is outside of the disc; accepted: one "
            "propeller and nothing else that moves (cut the picture, cover others), camera at rest"
        )
    return disc


def circle_of(hull: Array) -> Disc:
    """Fit a circle to the corners of a hull, in order, without outliers (RANSAC).

    Raises:
        ValueError: too few corners lie on one circle.
    """
    rng = np.random.default_rng(0)
    best: tuple[int, tuple[float, float, float]] = (0, (0.0, 0.0, 0.0))
    size = float(np.ptp(hull, axis=0).max())
    outline = _outline(hull)
    if len(hull) >= 3:
        for _ in range(_TRIES):
            x, y, r = _least_squares(hull[rng.choice(len(hull), 3, replace=False)])
            if not 0.25 * size < r < 1.5 * size:
                continue
            score = _filled(outline, x, y, r)
            if score > best[0]:
                best = score, (x, y, r)
    x, y, r = best[1]
    for _ in range(5):
        if r <= 0.0:
            break
        near = _on_circle(hull, x, y, r)
        x, y, r = _least_squares(hull[near])
    share = _filled(outline, x, y, r) / _BINS if r > 0.0 else 0.0
    if share < _LEAST_ARC:
        raise ValueError(
            f"what moves is not round: {100 * share:.0f} % of its hull is on a circle; accepted: "
            "one propeller seen along its axis, ten frames or more, camera at rest"
        )
    return Disc(x, y, r, hull)


def _on_circle(points: Array, x: float, y: float, r: float) -> NDArray[np.bool_]:
    off = np.hypot(points[:, 0] - x, points[:, 1] - y) - r
    return np.asarray(np.abs(off) < max(1.5, _ROUND * r))


def _filled(outline: Array, x: float, y: float, r: float) -> int:
    """Count directions in which the hull's outline lies on the circle."""
    on = outline[_on_circle(outline, x, y, r)]
    way = np.arctan2(on[:, 1] - y, on[:, 0] - x) % (2.0 * math.pi)
    return len(np.unique((way * (_BINS / (2.0 * math.pi))).astype(int)))


def _outline(hull: Array) -> Array:
    """Return points along the hull's sides, closer together than a direction's share."""
    steps = np.linspace(0.0, 1.0, 64, endpoint=False)[:, None, None]
    return np.asarray((hull + steps * (np.roll(hull, -1, axis=0) - hull)).reshape(-1, 2))


def _least_squares(p: Array) -> tuple[float, float, float]:
    if len(p) < 3:
        return 0.0, 0.0, 0.0
    matrix = np.column_stack([2.0 * p, np.ones(len(p))])
    (x, y, c), *_ = np.linalg.lstsq(matrix, (p**2).sum(axis=1), rcond=None)
    return float(x), float(y), math.sqrt(max(float(c + x * x + y * y), 0.0))


def _refuse_unlit(frames: Frames) -> None:
    sample = frames[:, ::3, ::3]
    dark, white = float(np.mean(sample < 6)), float(np.mean(sample > 250))
    if dark > 0.97:
        raise ValueError(
            f"the frames are black ({100 * dark:.0f} % of the pixels); accepted: lit ones"
        )
    if white > 0.6:
        raise ValueError(
            f"the frames are saturated ({100 * white:.0f} % of the pixels are white); accepted: a "
            "shorter exposure or less light"
        )
