"""The disc's rim to a few hundredths of a pixel, at any speed and exposure, from blade passes.

How much of the time a blade covers a point at radius x is its chord's angle there over 2 pi:
motion blur spreads the blade along the circle and leaves that share as it is. So what a pass
changes, summed along its arc, has the same profile over the radius at every speed and exposure:
that of the chord, which ends at the tip, times the brightness of the blade less that of the
background. `Rim.radius` is where this profile has fallen to half. That is somewhat inside of the
tip, always the same for the same blade, so it cancels in a ratio of two radii.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.special import ndtr

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.disc import Disc, Frames, remove_flicker

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

_STEP = 0.5
"""Pixels between samples along a radius."""
_DIRECTIONS = 1440
_PHI: Any = np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)
_INNER, _OUTER = 0.90, 1.07
"""The ring, in radii of the disc."""
_BLADE = (0.55, 0.88)
"""The ring in which blades are distinguished from the background."""
_GROUND_FRAMES = 2
"""Frames that must show what is behind a blade."""
_FALSE_SWING = 5.0
"""Swing of a blade in standard deviations of noise."""
_LEAST_PASSES = 8
_CENTRE_KNOWN = 3.0
"""Pixels by which the centre at rest may differ from the spinning disc's."""
_STEPS = 40
_RECENTRED = 4
_RADIUS, _CENTRE, _OVAL, _WIDTH, _BODY, _LIGHT = 0, 1, 3, 5, 6, 8
"""In the fit's parameters: radius, centre x, y, stretch (2), ln width, body (2), light (3)."""
_EXPECTED = np.array([0.0] * 8 + [60.0, 0.0, 0.0])
_PRIOR = np.array([0.0] * 6 + [0.2, 0.2] + [80.0**-2, 30.0**-2, 30.0**-2])
"""Inverse variances: brightness of the blade and its lighting [grey levels] are known roughly."""


@dataclass(frozen=True)
class Passes:
    """What passes of a blade change, summed along their arcs: one row a pass."""

    sums: Array
    """(pass, radius), grey levels."""
    weights: Array
    """Inverse variance, in units of a pixel's own."""
    waves: Array
    """(pass, 5): means of 1, cos phi, sin phi, cos 2 phi, sin 2 phi over the arc."""
    ground: Array
    """What is behind the blade (pass, radius), grey levels."""
    radii: Array
    """Pixels."""
    arc: float
    """Share of the directions."""
    rotation_per_frame: float
    """rad per frame, of a two-bladed propeller; NaN for one frame."""
    behind: Plane
    """What is behind the blades (direction, radius); NaN where it was never free."""


@dataclass(frozen=True)
class RadialProfile:
    """The profile of a pass over the radius near the rim."""

    radius: float
    """Of the rim that it was seen at [pixels]."""
    width: float
    """Standard deviation of the rim's blur [pixels]."""
    body: tuple[float, float]
    """Slope and bend inside of the rim, per 5 % of the radius."""

    def seen_at(self, radius: float, stretch: float) -> RadialProfile:
        """Return the blade's profile at a rim of `radius`, its span `stretch` times as long."""
        by = radius / self.radius / stretch
        body = (self.body[0] * by, self.body[1] * by * by)
        return RadialProfile(radius, self.width * stretch, body)


@dataclass(frozen=True)
class Rim:
    """The rim [pixels]: centre, mean radius, and its stretch in two directions."""

    x: float
    y: float
    radius: float
    sd: float
    """Standard deviation of the radius, from the scatter of the passes."""
    oval: tuple[float, float]
    """Stretch: radius + oval[0] cos 2 phi + oval[1] sin 2 phi."""
    oval_sd: float
    profile: RadialProfile
    contrast: float
    """How far a pass stands out, in standard deviations of what the fit leaves."""
    light: float
    """Brightness of the blades [grey levels]."""
    passes: Passes

    @property
    def tilt(self) -> float:
        """Angle [rad] between the camera's axis and the propeller's, from the stretch."""
        size = math.hypot(*self.oval)
        return math.acos(max(0.0, (self.radius - size) / (self.radius + size)))


def passes_of(frames: Frames, x: float, y: float, radius: float) -> Passes:
    """Take the blades' passes through the ring around a circle [pixels].

    Raises:
        InputError: no blade stands out.
    """
    even = remove_flicker(frames)
    swept, rotation_per_frame = _swept(even, x, y, radius)
    radii: Any = np.arange(_INNER * radius, _OUTER * radius, _STEP)
    stack, inside = _unrolled(even, x, y, radii, _PHI)
    free = (~swept).astype(np.float32)
    n_free = free.sum(axis=0)
    behind = np.einsum("kp,kpr->pr", free, stack) / np.maximum(n_free, 1.0)[:, None]
    behind[(n_free < _GROUND_FRAMES) | ~inside.all(axis=1)] = np.nan
    arcs = [(shot, arc) for shot, row in zip(stack, swept, strict=True) for arc in _arcs(row)]
    return _summed(arcs, n_free, behind, radii, rotation_per_frame)


def resting_passes(frame: Plane, x: float, y: float, spinning: Passes) -> Passes:
    """Take blades at rest for passes; what is behind them is known from when they spun.

    Raises:
        InputError: it isn't.
    """
    radii, behind = spinning.radii, spinning.behind
    stack, inside = _unrolled([frame], x, y, radii, _PHI)
    known: Any = np.isfinite(behind).all(axis=1) & inside.all(axis=1)
    if not known.any():
        raise InputError("what is behind the blades was never seen; accepted: more frames")
    shot = stack[0] / np.float32(np.median(stack[0][known] / np.maximum(behind[known], 1.0)))
    change = np.where(known[:, None], shot - behind, 0.0)
    within = np.abs(change[:, radii < 0.97 * radii[-1] / _OUTER].mean(axis=1))
    noise = 1.4826 * float(np.median(within[known])) + 0.3
    swept: Mask = maximum_filter1d(known & (within > _FALSE_SWING * noise), 21, mode="wrap")
    arcs = [(shot, arc) for arc in _arcs(swept)]
    return _summed(arcs, np.full(_DIRECTIONS, 10.0), behind, radii, math.nan)


def _summed(
    arcs: list[tuple[Plane, NDArray[np.intp]]],
    n_free: NDArray[Any],
    behind: Plane,
    radii: Array,
    rotation_per_frame: float,
) -> Passes:
    known: Any = np.isfinite(behind).all(axis=1)
    blade = radii < radii[0] + 0.5 * (radii[-1] / _OUTER - radii[0])
    sums, weights, waves, grounds = [], [], [], []
    seen = np.zeros(_DIRECTIONS, bool)
    for shot, arc in arcs:
        if not known[arc].all():
            continue
        change = shot[arc] - behind[arc]
        strength = np.abs(change[:, blade].mean(axis=1)).astype(float) + 1e-3
        strength /= strength.sum()
        phi = _PHI[arc]
        sums.append(change.sum(axis=0))
        weights.append(1.0 / (len(arc) + float((1.0 / n_free[arc]).sum())))
        waves.append(
            [1.0, *(float(strength @ f(n * phi)) for n in (1, 2) for f in (np.cos, np.sin))]
        )
        grounds.append(strength @ behind[arc])
        seen[arc] = True
    shape = (len(sums), len(radii))
    return Passes(
        np.array(sums, dtype=float).reshape(shape), np.array(weights, dtype=float),
        np.array(waves, dtype=float).reshape(len(sums), 5),
        np.array(grounds, dtype=float).reshape(shape), radii, float(seen.mean()),
        rotation_per_frame, behind,
    )  # fmt: skip


def _arcs(swept: Mask) -> list[NDArray[np.intp]]:
    """Return the runs of directions that are True, around the circle."""
    if swept.all() or not swept.any():
        return []
    order = (int(np.flatnonzero(~swept)[0]) + np.arange(_DIRECTIONS)) % _DIRECTIONS
    edges = np.flatnonzero(np.diff(np.concatenate([[0], swept[order].astype(int), [0]])))
    return [order[a:b] for a, b in edges.reshape(-1, 2)]


def _unrolled(
    frames: list[Plane], x: float, y: float, radii: Array, phi: Array
) -> tuple[Plane, Mask]:
    """Return frames over (direction, radius), and which of these points are in the picture."""
    at_x = (x + np.cos(phi)[:, None] * radii).astype(np.float32)
    at_y = (y + np.sin(phi)[:, None] * radii).astype(np.float32)
    height, width = frames[0].shape
    inside = (at_x >= 0) & (at_x <= width - 1) & (at_y >= 0) & (at_y <= height - 1)
    rolled: Any = [cv2.remap(f, at_x, at_y, cv2.INTER_LINEAR) for f in frames]
    return np.stack(rolled), inside


def _swept(frames: list[Plane], x: float, y: float, radius: float) -> tuple[Mask, float]:
    """Return which directions a blade sweeps in each frame (k, direction), and rad per frame."""
    coarse = _DIRECTIONS // 4
    phi: Any = np.arange(coarse) * (2.0 * math.pi / coarse)
    radii: Any = np.linspace(_BLADE[0] * radius, _BLADE[1] * radius, 32)
    stack, inside = _unrolled(frames, x, y, radii, phi)
    stack = np.where(inside, stack, 0.0)
    swing = np.abs(stack - np.median(stack, axis=0)).mean(axis=2)
    swing = np.maximum(swing, np.roll(swing, coarse // 2, axis=1))  # two blades
    usual = np.median(swing)
    noise = 1.4826 * np.median(np.abs(swing - usual))
    floor = max(usual + _FALSE_SWING * noise, 0.08 * float(np.percentile(swing, 98)))
    swept: Mask = maximum_filter1d(swing > floor, 11, axis=1, mode="wrap")
    if swept.mean() > 0.9 or not swept.any():
        raise InputError("no blade stands out in single frames; accepted: more light or contrast")
    wave = (swing * np.exp(-2j * phi)).sum(axis=1)
    turns = wave[1:] * wave[:-1].conj()
    rotation_per_frame = abs(float(np.angle(turns.sum()))) / 2.0 if len(turns) else math.nan
    return np.repeat(swept, 4, axis=1), rotation_per_frame


def find_rim(frames: Frames, disc: Disc) -> Rim:
    """Refine a disc to its rim.

    Raises:
        InputError: no rim stands out, or it runs out of the picture.
    """
    x, y, radius, oval = disc.x, disc.y, disc.radius * 1.003, (0.0, 0.0)
    for turn in range(_RECENTRED):
        fit = fit_rim(passes_of(frames, x, y, radius), radius, oval)
        moved = max(abs(fit.x), abs(fit.y), abs(fit.radius - radius))
        x, y, radius, oval = x + fit.x, y + fit.y, fit.radius, fit.oval
        if moved < 0.3 and turn:
            break
    if not 0.85 < radius / disc.radius < 1.15:
        raise InputError("the disc has no clear rim; accepted: more light, contrast or frames")
    return Rim(x, y, radius, fit.sd, oval, fit.oval_sd, fit.profile, fit.contrast, fit.light,
               fit.passes)  # fmt: skip


def fit_rim(
    passes: Passes,
    radius: float,
    oval: tuple[float, float] = (0.0, 0.0),
    *,
    round_known: bool = False,
    like: RadialProfile | None = None,
) -> Rim:
    """Fit circle, stretch and profile to passes (Levenberg and Marquardt).

    Args:
        passes: in a ring about the centre; `x` and `y` of the result are the centre's shift.
        radius: first guess.
        oval: first guess of the stretch.
        round_known: keep the stretch, and the centre to some pixels: for blades at rest.
        like: the profile, if it is known from other passes of the same blade.

    Raises:
        InputError: too few passes.
    """
    if len(passes.sums) < (1 if round_known else _LEAST_PASSES):
        raise InputError(
            f"{len(passes.sums)} clear passes of a blade; accepted: {_LEAST_PASSES} or more, of a "
            "propeller that turns and stands out, the whole disc in the picture"
        )
    p = np.array([radius, 0.0, 0.0, *oval, math.log(1.5), 0.0, 0.0, *_EXPECTED[_LIGHT:]])
    free, prior_of = np.arange(len(p)), _PRIOR
    if like is not None:
        p[_WIDTH : _BODY + 2] = math.log(like.width), *like.body
        free = np.delete(free, [_WIDTH, _BODY, _BODY + 1])
    if round_known:
        free = np.setdiff1d(free, [_OVAL, _OVAL + 1, _LIGHT + 1, _LIGHT + 2])
        prior_of = _PRIOR.copy()
        prior_of[_CENTRE : _CENTRE + 2] = _CENTRE_KNOWN**-2
    residual, slopes, swing = _misfit(p, passes)
    noise = math.sqrt(float(np.mean(residual**2)))
    damping = 1e-3
    for _ in range(_STEPS):
        prior = prior_of * noise**2
        held = float(np.sum(residual**2) + np.sum(prior * (p - _EXPECTED) ** 2))
        matrix = (np.einsum("srp,srq->pq", slopes, slopes) + np.diag(prior))[np.ix_(free, free)]
        rhs = (np.einsum("srp,sr->p", slopes, residual) + prior * (_EXPECTED - p))[free]
        step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix) + 1e-12), rhs)
        trial = p.copy()
        trial[free] += np.clip(step, -0.03 * radius, 0.03 * radius)
        trial[_WIDTH] = np.clip(trial[_WIDTH], math.log(0.3), math.log(0.04 * radius + 1.0))
        tried = _misfit(trial, passes)
        cost = float(np.sum(tried[0] ** 2) + np.sum(prior * (trial - _EXPECTED) ** 2))
        if cost > held:
            damping *= 8.0
            if damping > 1e8:
                break
            continue
        p, (residual, slopes, swing) = trial, tried
        noise = math.sqrt(float(np.mean(residual**2)))
        damping = max(damping * 0.2, 1e-9)
        if held - cost < 1e-7 * held:
            break
    sd = _deviations(
        residual, slopes[:, :, free], prior_of[free] * noise**2, robust=not round_known
    )
    contrast = float(np.sqrt(np.mean(swing**2 * passes.weights))) / max(noise, 1e-9)
    body = (float(p[_BODY]), float(p[_BODY + 1]))
    profile = RadialProfile(float(p[_RADIUS]), math.exp(float(p[_WIDTH])), body)
    oval_sd = math.nan if round_known else float(max(sd[_OVAL], sd[_OVAL + 1]))
    return Rim(float(p[1]), float(p[2]), float(p[0]), float(sd[0]), (float(p[3]), float(p[4])),
               oval_sd, profile, contrast, float(p[_LIGHT]), passes)  # fmt: skip


def _deviations(residual: Array, slopes: Array, prior: Array, *, robust: bool) -> Array:
    """Return standard deviations; robust: from the scatter of whole passes, not of samples."""
    count, free = len(residual), slopes.shape[-1]
    noise = float(np.sum(residual**2)) / max(residual.size - 2 * count - free, 1)
    inverse = np.linalg.inv(np.einsum("srp,srq->pq", slopes, slopes) + np.diag(prior + 1e-12))
    plain = np.diag(inverse) * noise
    if not robust:  # too few passes for a scatter; neighbouring samples say the same twice
        return np.asarray(np.sqrt(4.0 * plain))
    scores = np.einsum("srp,sr->sp", slopes, residual)
    few = count / max(count - free, 1.0)
    return np.asarray(
        np.sqrt(np.maximum(np.diag(inverse @ (scores.T @ scores) @ inverse) * few, plain))
    )


def _misfit(p: Array, passes: Passes) -> tuple[Array, Array, Array]:
    """Return weighted residuals (s, r), slopes (s, r, p) without what swing and level take up."""
    root, waves = np.sqrt(passes.weights)[:, None], passes.waves
    out = passes.radii[None, :] - (waves @ p[:_WIDTH])[:, None]
    width = math.exp(p[_WIDTH])
    z = out / width
    edge = ndtr(-z)
    bell = np.exp(-0.5 * z * z) / (width * math.sqrt(2.0 * math.pi))
    scale = 0.05 * p[_RADIUS]
    u = out / scale
    body = 1.0 + p[_BODY] * u + p[_BODY + 1] * u * u
    # What a blade changes is its own brightness less that of what it hides.
    depth = (passes.ground - (waves[:, :3] @ p[_LIGHT:])[:, None]) / 100.0
    profile = depth * body * edge
    bare = np.stack([profile, np.ones_like(profile)], axis=-1)
    gram = np.einsum("sri,srj->sij", bare, bare) + 1e-9 * np.eye(2)
    weights = np.linalg.solve(gram, np.einsum("sri,sr->si", bare, passes.sums)[..., None])[..., 0]
    residual = passes.sums - np.einsum("sri,si->sr", bare, weights)
    slopes = np.empty((*profile.shape, len(p)))
    by_radius = depth * (body * bell - (p[_BODY] + 2.0 * p[_BODY + 1] * u) / scale * edge)
    slopes[..., :_WIDTH] = by_radius[..., None] * waves[:, None, :]
    slopes[..., _WIDTH] = depth * body * bell * out
    slopes[..., _BODY] = depth * u * edge
    slopes[..., _BODY + 1] = depth * u * u * edge
    slopes[..., _LIGHT:] = -0.01 * (body * edge)[..., None] * waves[:, None, :3]
    slopes *= weights[:, 0, None, None]
    explained = np.linalg.solve(gram, np.einsum("sri,srp->sip", bare, slopes))
    slopes -= np.einsum("sri,sip->srp", bare, explained)
    return residual * root, slopes * root[..., None], weights[:, 0]
