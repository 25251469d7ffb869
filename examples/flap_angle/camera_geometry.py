"""How a flapped propeller looks to a camera on its axis, and which angles look like that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LIMIT_95 = 1.96
_STEP = math.radians(0.01)
_LARGEST = math.radians(80.0)
_GAP = math.radians(0.05)
_STRANGE = 4.0
"""Standard deviations by which no angle explains a radius: then something else is wrong."""


@dataclass(frozen=True)
class BladeSpan:
    """Tip and nodus of the straight blade, distances from the axis [m]."""

    tip: float
    nodus: float

    def __post_init__(self) -> None:
        if not 0.0 < self.nodus < self.tip < 10.0:
            raise ValueError(
                f"tip radius {self.tip * 1e3:g} mm, nodus radius {self.nodus * 1e3:g} mm; "
                "accepted: 0 < nodus < tip < 10000 mm"
            )


@dataclass(frozen=True)
class CameraPose:
    """Where the camera is: `height` [m] from it to the disc of the straight blades.

    `towards` says that the blades flap towards it (it looks from above); `height_error` is the
    share of the height by which it may be wrong (one standard deviation).
    """

    height: float = math.inf
    towards: bool = True
    height_error: float = 0.01

    def __post_init__(self) -> None:
        if not self.height > 0.0:
            raise ValueError(f"camera height {self.height:g} m; accepted: above 0")
        if not 0.0 <= self.height_error < 0.5:
            raise ValueError(
                f"error of the camera height {self.height_error:g}; accepted: a share, 0 to 0.5"
            )


@dataclass(frozen=True)
class FlapAngle:
    """Flap angle [rad] from a disc's radius."""

    best: float
    """The most likely angle; no result by itself unless `resolved`."""
    low: float
    high: float
    """Ends of the 95 % interval."""
    pieces: tuple[tuple[float, float], ...]
    """The interval without what is excluded in between: two angles can look the same."""
    misfit: float
    """Standard deviations between the radius and that of the nearest angle."""

    @property
    def resolved(self) -> bool:
        """Whether zero is excluded and one angle is left."""
        return self.low > 0.0 and len(self.pieces) == 1

    @property
    def inconsistent(self) -> bool:
        """Whether no angle looks like this."""
        return self.misfit > _STRANGE

    def as_text(self) -> str:
        """Say it with its interval; an angle that the diameter does not resolve is NaN."""
        if self.inconsistent:
            return "no angle: the disc is larger than any flap makes it"
        if len(self.pieces) > 1:
            parts = [f"{math.degrees(a):.1f} to {math.degrees(b):.1f}" for a, b in self.pieces]
            return " or ".join(parts) + " deg: seen from there they look the same"
        if not self.resolved:
            high = math.degrees(self.high)
            return f"at most {high:.1f} deg: by the diameter it may be 0"
        return (
            f"{math.degrees(self.best):.1f} deg "
            f"({math.degrees(self.low):.1f} to {math.degrees(self.high):.1f})"
        )


def tip_height(beta: Array, span: BladeSpan) -> Array:
    """Return how far the tip leaves the straight blades' disc [m]."""
    return np.asarray((span.tip - span.nodus) * np.sin(beta))


def apparent_radius(beta: Array, span: BladeSpan, view: CameraPose) -> Array:
    """Return the disc's radius [m], as the scale of the straight blades' disc measures it.

    The wing beyond the nodus is foreshortened by cos(beta), and its tip is nearer to the camera,
    or further from it, by the tip's height: r_N + (r - r_N) cos(beta), times H / (H -+ z).
    """
    beta = np.asarray(beta, dtype=float)
    seen = span.nodus + (span.tip - span.nodus) * np.cos(beta)
    sign = 1.0 if view.towards else -1.0
    return np.asarray(seen / (1.0 - sign * tip_height(beta, span) / view.height))


def paper_angle(radius: float, span: BladeSpan) -> float:
    """Return acos((r_d - r_N) / (r - r_N)) [rad], the paper's beta; NaN where there is none.

    It holds for a camera at a great distance: see `apparent_radius`.
    """
    ratio = (radius - span.nodus) / (span.tip - span.nodus)
    return math.acos(ratio) if -1.0 <= ratio <= 1.0 else math.nan


def angle(radius: float, sd: float, span: BladeSpan, view: CameraPose) -> FlapAngle:
    """Return the angles that look like a disc of `radius` +- `sd` [m].

    An angle is in the interval if its likelihood is not less than that of the best angle by more
    than 95 % allow; so the interval is never empty, also where noise makes the disc too large.

    Raises:
        ValueError: no finite radius, or no positive standard deviation.
    """
    if not (math.isfinite(radius) and radius > 0.0 and math.isfinite(sd) and sd > 0.0):
        raise ValueError(f"disc radius {radius:g} +- {sd:g} m; accepted: finite and above 0")
    beta: Any = np.arange(0.0, _LARGEST + _STEP, _STEP)
    seen = apparent_radius(beta, span, view)
    from_height = seen * tip_height(beta, span) / view.height * view.height_error
    distance = (radius - seen) ** 2 / (sd**2 + from_height**2)
    k = int(np.argmin(distance))
    inside = np.flatnonzero(distance - distance[k] <= LIMIT_95**2)
    breaks = np.flatnonzero(np.diff(beta[inside]) > _GAP)
    firsts = [inside[0], *inside[breaks + 1]]
    lasts = [*inside[breaks], inside[-1]]
    pieces = tuple((float(beta[a]), float(beta[b])) for a, b in zip(firsts, lasts, strict=True))
    return FlapAngle(
        float(beta[k]), pieces[0][0], pieces[-1][1], pieces, math.sqrt(float(distance[k]))
    )
