"""Measure rendered films of a spinning propeller whose flap angle is known.

    python beta_from_video.py [--films 210] [--seed 0] [--near] [--px-per-mm 2.5]

Every film: 20 frames at 960 frames/s, 2000 to 5000 rpm, exposure 0.1 to 1 of the frame interval,
hub off centre by up to 25 pixels, camera tilted by some degrees, varied light, clutter, flicker,
defocus, noise, twist and tip shape; camera 5 to 10 m above, its height known to 1 %. The scale
comes from 32 frames of the same propeller at 700 to 1000 rpm, straight. `--near`: other heights.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.camera_geometry import (
    BladeSpan,
    CameraPose,
    FlapAngle,
    ambiguous_angle_limit,
    apparent_radius,
)
from tombo_propeller.flap_video.measure import measure, reference_scale, spans_of
from tombo_propeller.flap_video.synthetic_video import Scene, SyntheticVideo

SPAN = BladeSpan(0.1111, 0.035)
ANGLES = (0.0, 2.0, 4.0, 8.0, 12.0, 20.0, 30.0)
FRAMES = 20


def scene_of(rng: np.random.Generator, beta_deg: float, px_per_mm: float) -> Scene:
    """Return a random scene with a known angle."""
    return Scene(
        beta=math.radians(beta_deg),
        speed=rng.uniform(210.0, 524.0),
        exposure=rng.uniform(0.1, 1.0),
        off_centre=(rng.uniform(-25.0, 25.0), rng.uniform(-25.0, 25.0)),
        tilt=abs(rng.normal(0.0, 0.04)),
        tilt_direction=rng.uniform(0.0, 2.0 * math.pi),
        camera_height=rng.uniform(5.0, 10.0),
        tip_rounding=rng.uniform(0.0011, 0.008),
        twist=rng.uniform(0.0, 0.15),
        blade_light=rng.uniform(0.05, 0.25),
        ground_light=rng.uniform(0.45, 0.75),
        gradient=rng.uniform(0.0, 0.4),
        clutter=rng.uniform(0.0, 0.2),
        flicker=float(rng.choice([0.0, 0.05])),
        defocus=rng.uniform(0.5, 1.3),
        noise=rng.uniform(0.004, 0.025),
        scale=px_per_mm * 1e3 * rng.uniform(0.8, 1.0),
        phase=rng.uniform(0.0, math.pi),
    )


@dataclass(frozen=True)
class Result:
    """What is kept of a measurement."""

    overall: FlapAngle
    paper: float
    z: float
    """Error of the disc's radius in its standard deviations."""


def measured(scene: Scene, seed: int, rng: np.random.Generator) -> Result:
    """Measure a scene against slow frames of it."""
    slow = replace(scene, beta=0.0, twist=0.0, speed=rng.uniform(70.0, 110.0))
    height = scene.camera_height * (1.0 + 0.01 * rng.normal())
    view = CameraPose(height, scene.towards)
    frames = np.stack(list(SyntheticVideo(slow, seed).frames(32)))
    film = SyntheticVideo(scene, seed)
    found = measure(
        film, spans_of(FRAMES, 10, 2), lambda rim: reference_scale(frames, 0.0, SPAN, view, rim),
        SPAN, view,
    )  # fmt: skip
    seen = float(
        apparent_radius(np.array(scene.beta), SPAN, CameraPose(scene.camera_height, scene.towards))
    )
    z = (found.radius - seen) / found.radius_sd
    return Result(found.overall, found.windows[0].paper, z)


def table(rows: Sequence[tuple[float, Result | None]], label: str) -> None:
    """Print a line an angle."""
    for beta in sorted({b for b, _ in rows}):
        found = [m for b, m in rows if b == beta and m is not None]
        refused = sum(m is None for b, m in rows if b == beta)
        best = np.degrees([m.overall.best for m in found])
        paper = np.degrees([m.paper for m in found])
        inside = [
            m.overall.low - 1e-9 <= math.radians(beta) <= m.overall.high + 1e-9 for m in found
        ]
        half = np.degrees([0.5 * (m.overall.high - m.overall.low) for m in found])
        valid = paper[np.isfinite(paper)]
        paper_error = float(np.median(np.abs(valid - beta))) if len(valid) else math.nan
        named = np.mean([m.overall.resolved for m in found])
        print(
            f"{label} {beta:6.1f} {len(found):6d} {refused:7d} {np.mean(best - beta):8.3f} "
            f"{np.percentile(np.abs(best - beta), 95):8.3f} {np.abs(best - beta).max():8.3f} "
            f"{np.median(half):8.2f} {100 * np.mean(inside):8.1f} {100 * named:8.0f} "
            f"{math.sqrt(np.mean([m.z**2 for m in found])):6.2f} "
            f"{paper_error:10.2f} {np.isnan(paper).sum():6d}",
            flush=True,
        )
    found = [(b, m) for b, m in rows if m is not None]
    inside = [m.overall.low - 1e-9 <= math.radians(b) <= m.overall.high + 1e-9 for b, m in found]
    print(f"{label} coverage {100 * np.mean(inside):.1f} % of {len(found)} films")


def main() -> None:
    """Render, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--films", type=int, default=210)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--near", action="store_true")
    parser.add_argument("--px-per-mm", type=float, default=2.5)
    options = parser.parse_args()
    cases: list[tuple[str, float, bool]] = [("5-10 m above", math.nan, True)]
    if options.near:
        cases = [("0.5 m above", 0.5, True), ("1 m above", 1.0, True), ("2 m above", 2.0, True),
                 ("1 m below", 1.0, False), ("3 m below", 3.0, False)]  # fmt: skip
    print(
        "camera angle films refused bias[deg] p95 max half-interval coverage[%] resolved[%] z-rms "
        "paper's-error paper-without-angle"
    )
    for label, height, towards in cases:
        rng = np.random.default_rng(options.seed)
        rows: list[tuple[float, Result | None]] = []
        for k in range(options.films):
            beta = ANGLES[k % len(ANGLES)]
            scene = scene_of(rng, beta, options.px_per_mm)
            if not math.isnan(height):
                scene = replace(scene, camera_height=height, towards=towards)
            try:
                rows.append((beta, measured(scene, k, rng)))
            except InputError as error:
                print(f"film {k} at {beta:g} deg: {error}")
                rows.append((beta, None))
        table(rows, label)
        if towards and not math.isnan(height):
            blind = math.degrees(ambiguous_angle_limit(SPAN, CameraPose(height)))
            print(f"{label}: below {blind:.1f} deg two angles look the same")


if __name__ == "__main__":
    main()
