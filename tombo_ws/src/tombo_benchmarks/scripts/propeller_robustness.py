"""Whether the propeller's solver finds the physical root, over random propellers and speeds.

    python propeller_robustness.py [--sets 1000000] [--law repaired]

Every set is a propeller drawn from `RANGES`, far wider than anything built, at a speed from 0 to
18 000 rpm. For each law it says how many are in the coefficients' range, beyond it or lost; what
is left of the equations, by quadrature along the span; how often Newton's method alone would have
found another root or none; and, for the first of the sets, whether the solver agrees with the path
from rest in short steps. Then it follows propellers along speed: the largest jump between
neighbours against their slopes.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import (
    LAWS,
    SPEED_LIMIT,
    Operation,
    configuration,
    evaluate_rows,
    parameter_rows,
)
from tombo_dynamics.propeller.blade import drag_coefficient, lift_coefficient, shape
from tombo_dynamics.propeller.laws.equilibrium import newton
from tombo_dynamics.propeller.laws.parameters import unpack

RANGES: dict[str, tuple[float, float]] = {
    "matrix_modulus_MPa": (0.08, 2.0),  # Table I: 0.115 to 0.589
    "poisson_ratio": (0.30, 0.499),
    "fibres": (0, 8),
    "fibre_diameter_mm": (0.2, 1.0),
    "fibre_youngs_modulus_MPa": (500.0, 5000.0),
    "fibre_shear_modulus_MPa": (20.0, 1100.0),
    "length_mm": (4.0, 20.0),  # 12
    "outer_radius_m": (0.028, 0.060),  # 0.035
    "flap_second_moment_mm4": (170.0, 1500.0),  # 506
    "lag_second_moment_mm4": (330.0, 3000.0),  # 979
    "torsion_constant_m4": (3e-10, 1.4e-8),  # 4.704e-9, which is 13 times too large
    "lift_arm_mm": (-1.0, 6.0),  # 3.15
    "drag_arm_mm": (-1.0, 2.5),  # 0.76
    "wing_mass_kg": (0.002, 0.012),  # 0.0057
    "wing_centroid_m": (0.050, 0.085),  # 0.0666
    "flap_offset_rad": (-0.05, 0.25),  # 0.1221
    "lag_offset_rad": (-0.05, 0.28),  # 0.1418
    "air_density_kg_m3": (0.8, 1.4),
}
"""What is drawn, its bounds; positive ones over more than a factor of 4 by their logarithm."""
PUBLISHED = {"fibre_diameter_mm", "matrix_modulus_MPa", "poisson_ratio", "length_mm"}
PUBLISHED |= {"fibre_youngs_modulus_MPa", "flap_second_moment_mm4", "lag_second_moment_mm4"}
PUBLISHED |= {"lift_arm_mm", "drag_arm_mm", "wing_mass_kg", "wing_centroid_m"}
PUBLISHED |= {"flap_offset_rad", "lag_offset_rad", "air_density_kg_m3"}
"""Those that the law published knows."""
CHUNK = 20_000
ANGLES = ("alpha_rad", "beta_rad", "gamma_rad")


def random_changes(rng: np.random.Generator, count: int, law: str) -> dict[str, Array]:
    """Return quantities of `count` random propellers."""
    found: dict[str, Array] = {}
    for name, (low, high) in RANGES.items():
        share = rng.random(count)
        if law == "published" and name not in PUBLISHED:
            continue
        if name == "fibres":
            found[name] = np.floor(low + share * (high + 1 - low))
        elif low > 0.0 and high > 4.0 * low:
            found[name] = low * (high / low) ** share
        else:
            found[name] = low + share * (high - low)
    return found


def residual(rows: Array, changes: dict[str, Array], points: Operation, law: str) -> Array:
    """Return the largest of the three equations' residuals [rad], (n,).

    The wing's loads come from quadrature along the span, not from the closed forms.
    """
    blade, p = configuration(13).blade, unpack(rows.T)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    root, tip = changes["outer_radius_m"][:, None], blade.pieces[-1].end_m
    join = np.maximum(root, blade.pieces[0].end_m)
    lift, drag = np.zeros(len(rows)), np.zeros(len(rows))
    alpha, beta, gamma = (getattr(points, name) for name in ANGLES)
    for start, end in ((root, join), (join, np.full_like(root, tip))):
        x = 0.5 * (end - start) * nodes + 0.5 * (end + start)
        depth, pitch = shape(blade, np.minimum(x, np.nextafter(end, 0.0)))
        load = 0.5 * (end - start) * weights * depth * x**2
        attack = pitch - gamma[:, None]
        load *= np.cos(attack) / np.cos(pitch)
        lift += (load * lift_coefficient(blade.section, attack)).sum(1)
        drag += (load * drag_coefficient(blade.section, attack)).sum(1)
    square = points.speed_rad_s**2
    q, pull = p.air_density * square * np.cos(alpha) * np.cos(beta), p.centrifugal * square
    up = q * lift - p.wing_weight - pull * np.tan(beta - p.flap_offset)
    back = q * drag + pull * np.tan(p.lag_offset - alpha)
    twisting = q * drag + pull * np.tan(alpha) if law == "repaired" else back
    ratio = p.joint_radius / p.wing_centroid
    left = np.stack(
        [
            alpha - p.lag_compliance / ratio * back,
            beta - p.flap_compliance * ratio * up,
            gamma - p.twist_compliance * (up * p.lift_arm + twisting * p.drag_arm),
        ]
    )
    return np.asarray(np.abs(left).max(0))


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def by_path(law: int, rows: Array, speeds: Array, out: Array) -> None:
    """Write the root from rest by short steps, none over 0.03 rad, or NaN where the path ends."""
    for i in range(speeds.shape[0]):
        p, square = unpack(rows[i]), speeds[i] ** 2
        a, b = 0.0, -p.flap_compliance * p.joint_radius / p.wing_centroid * p.wing_weight
        g = -p.twist_compliance * p.wing_weight * p.lift_arm
        here, step = 0.0, square / 64.0
        while here < square and step > 1e-10 * square:
            there = min(square, here + step)
            x, y, z, determinant, found, _, _, _ = newton(law, p, there, a, b, g, 1e-9)
            near = max(abs(x - a), abs(y - b), abs(z - g)) < 0.03
            if found and determinant > 0.0 and near:
                a, b, g, here = x, y, z, there
                step = min(1.5 * step, square / 64.0)
            else:
                step *= 0.5
        out[i, 0] = a if here >= square else np.nan
        out[i, 1] = b if here >= square else np.nan
        out[i, 2] = g if here >= square else np.nan


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def by_newton(law: int, rows: Array, speeds: Array, out: Array) -> None:
    """Write the root that Newton's method finds from 0.1 rad, or NaN."""
    for i in range(speeds.shape[0]):
        p = unpack(rows[i])
        a, b, g, d, found, _, _, _ = newton(law, p, speeds[i] ** 2, 0.1, 0.1, 0.1, 1e-9)
        good = found and d > 0.0
        out[i, 0] = a if good else np.nan
        out[i, 1] = b if good else np.nan
        out[i, 2] = g if good else np.nan


@dataclass
class Counts:
    """What came of the sets of one law."""

    sets: int = 0
    valid: int = 0
    beyond: int = 0
    lost: int = 0
    bare: int = 0
    """Valid points with an angle that is not finite: there must be none."""
    residual: float = 0.0
    paths: int = 0
    """Sets that were compared with the path in short steps."""
    apart: float = 0.0
    """Largest distance from the path's root [rad]."""
    against_path: int = 0
    """Sets where solver and path disagree on whether there is a root in range, or on which."""
    newton_wrong: int = 0
    newton_none: int = 0


def check(law: str, sets: int, seed: int, paths: int) -> Counts:
    """Return the counts of one law over random sets, the first of them compared with paths."""
    rng, counts = np.random.default_rng([seed, LAWS[law]]), Counts()
    for start in range(0, sets, CHUNK):
        count = min(CHUNK, sets - start)
        changes = random_changes(rng, count, law)
        speeds = rng.uniform(0.0, SPEED_LIMIT, count)
        rows = parameter_rows(13, law, **changes)
        points = evaluate_rows(rows, speeds, law, "keep")
        angles = np.stack([getattr(points, name) for name in ANGLES], axis=1)
        counts.sets += count
        counts.valid += int(points.valid.sum())
        counts.beyond += int((points.verdict == 1).sum())
        counts.lost += int((points.verdict == 2).sum())
        finite = np.isfinite(angles).all(1) & np.isfinite(points.thrust_N)
        counts.bare += int((points.valid & ~finite).sum())
        if law == "published":
            continue
        left = residual(rows, changes, points, law)[points.valid]
        counts.residual = max(counts.residual, float(left.max(initial=0.0)))
        limit = unpack(rows.T).twist_limit
        if start < paths:
            counts.paths += count
            path = np.empty((count, 3))
            by_path(LAWS[law], rows, speeds, path)
            in_range = np.isfinite(path[:, 2]) & (path[:, 2] <= limit)
            apart = np.abs(angles - path).max(1)[points.valid & in_range]
            counts.against_path += int((points.valid != in_range).sum() + (apart > 1e-6).sum())
            counts.apart = max(counts.apart, float(apart[apart <= 1e-6].max(initial=0.0)))
        alone = np.empty((count, 3))
        by_newton(LAWS[law], rows, speeds, alone)
        off = np.abs(angles - alone).max(1)
        counts.newton_none += int((points.valid & ~np.isfinite(off)).sum())
        counts.newton_wrong += int((points.valid & (off > 1e-6)).sum())
        counts.newton_wrong += int((~points.valid & (alone[:, 2] <= limit)).sum())
    return counts


def continuity(law: str, propellers: int, seed: int, speeds: int = 2001) -> tuple[float, float]:
    """Return how far neighbours along speed are apart, over what their slopes allow.

    The largest difference of an angle between neighbours over the grid's step times the larger
    slope of the two (by differences a hundredth of the step wide); differences below 1e-6 rad are
    left out. It is 1 on smooth curves, far more at a jump. Then the largest difference [rad]. Only
    up to where a propeller is valid.
    """
    rng = np.random.default_rng([seed, 10 + LAWS[law]])
    ratio, jump = 0.0, 0.0
    grid = np.linspace(0.0, SPEED_LIMIT, speeds)
    step = float(grid[1])
    nudge = np.clip(grid[:, None] + 0.01 * step * np.array([-0.5, 0.0, 0.5]), 0.0, SPEED_LIMIT)
    for _ in range(propellers):
        rows = parameter_rows(13, law, **random_changes(rng, 1, law))[0]
        points = evaluate_rows(rows, nudge, law, "mask")
        whole = points.valid.all(1)
        end = len(grid) if whole.all() else int(np.argmin(whole))
        for name in ANGLES:
            angle = getattr(points, name)[:end]
            if len(angle) < 3:
                continue
            width = nudge[:end, 2] - nudge[:end, 0]
            slope = np.abs(angle[:, 2] - angle[:, 0]) / width
            rise = np.abs(np.diff(angle[:, 1]))
            bound = step * np.maximum(slope[1:], slope[:-1])
            jump = max(jump, float(rise.max()))
            ratio = max(ratio, float((rise / np.maximum(bound, 1e-6)).max()))
    return ratio, jump


def say(text: str = "") -> None:
    """Write a line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def report(law: str, counts: Counts) -> None:
    """Write what came of one law."""

    def share(number: int) -> str:
        return f"{number:9d}  {100.0 * number / counts.sets:8.4f} %"

    say(f"law {law}: {counts.sets} random propellers, each at one speed")
    say(f"  valid: physical root, within the coefficients' range  {share(counts.valid)}")
    say(f"  beyond: the twist leaves the coefficients' range       {share(counts.beyond)}")
    say(f"  lost: the path from rest turns back, said so           {share(counts.lost)}")
    say(f"  neither (valid, but not finite)                        {share(counts.bare)}")
    if law == "published":
        say("  (no equations to check: four explicit passes, each with one root, see laws/spring)")
        return
    say(f"  largest residual of the equations, by quadrature       {counts.residual:9.1e} rad")
    say(
        f"  the path in short steps, {counts.paths} sets: {counts.against_path} disagree, "
        f"elsewhere within {counts.apart:.1e} rad"
    )
    say(f"  Newton alone would find another root                   {share(counts.newton_wrong)}")
    say(f"  Newton alone would find none                           {share(counts.newton_none)}")


def main() -> None:
    """Read the options, check, report."""
    options: Any = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    options.add_argument("--sets", type=int, default=1_000_000, help="random sets a law")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--law", choices=[*LAWS], action="append", help="default: all three")
    options.add_argument("--paths", type=int, default=100_000, help="sets compared with paths")
    options.add_argument("--curves", type=int, default=300, help="propellers followed over speed")
    given = options.parse_args()
    if given.sets < 1 or min(given.curves, given.seed, given.paths) < 0:
        options.error("--sets from 1, --curves, --paths and --seed from 0")
    for law in given.law or LAWS:
        start = time.perf_counter()
        report(law, check(law, given.sets, given.seed, given.paths))
        if given.curves:
            ratio, jump = continuity(law, given.curves, given.seed)
            say(
                f"  along speed ({given.curves} propellers, 2001 speeds each): largest difference "
                f"of neighbours {math.degrees(jump):.2f} deg, {ratio:.3f} of what their slopes "
                "allow"
            )
        say(f"  {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
