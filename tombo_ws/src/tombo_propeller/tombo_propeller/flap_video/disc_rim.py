"""The disc's rim to a few hundredths of a pixel, at any speed and exposure, from blade passes.

Every pass has the same profile over the radius: that of the chord, which ends at the tip, times
the brightness of the blade less that of the background. `Rim.radius` is where this profile has
fallen to half. That is somewhat inside of the tip, always the same for the same blade, so it
cancels in a ratio of two radii.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.blade_passes import Passes, passes_of
from tombo_propeller.flap_video.disc import Disc, Frames

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
    found = np.linalg.solve(gram, np.einsum("sri,sr->si", bare, passes.sums)[..., None])[..., 0]
    residual = passes.sums - np.einsum("sri,si->sr", bare, found)
    slopes = np.empty((*profile.shape, len(p)))
    by_radius = depth * (body * bell - (p[_BODY] + 2.0 * p[_BODY + 1] * u) / scale * edge)
    slopes[..., :_WIDTH] = by_radius[..., None] * waves[:, None, :]
    slopes[..., _WIDTH] = depth * body * bell * out
    slopes[..., _BODY] = depth * u * edge
    slopes[..., _BODY + 1] = depth * u * u * edge
    slopes[..., _LIGHT:] = -0.01 * (body * edge)[..., None] * waves[:, None, :3]
    slopes *= found[:, 0, None, None]
    taken = np.linalg.solve(gram, np.einsum("sri,srp->sip", bare, slopes))
    slopes -= np.einsum("sri,sip->srp", bare, taken)
    return residual * root, slopes * root[..., None], found[:, 0]
