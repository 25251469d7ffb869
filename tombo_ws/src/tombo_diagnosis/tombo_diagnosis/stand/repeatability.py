"""By how much runs of one propeller differ."""

from __future__ import annotations

import numpy as np

from tombo_diagnosis.stand.problem import StandProblem

_MIN_SIGMAS = 3.0
"""Standard deviations of the difference."""
_CHANNELS = ("thrust", "torque")


def repeats(problem: StandProblem) -> list[str]:
    """Return, for each propeller with several runs, the share by which they differ, in words.

    Of each run the share by which its load is off the model's, weighted least squares.
    """
    points, setup = problem.points, problem.points.setup
    model = problem.prediction(problem.theta)
    found = []
    for p, name in enumerate(points.propellers):
        for c, channel in enumerate(_CHANNELS):
            shares: dict[str, tuple[float, float]] = {}
            for r in np.unique(setup.run[setup.propeller == p]):
                own = problem.seen[:, c] & (setup.run == r) & (setup.propeller == p)
                own &= setup.speed > 0.0
                m = np.where(own, model[:, c], 0.0) / problem.sigma[:, c]
                square = float(m @ m)
                if square > 0.0:
                    left = np.where(own, problem.left[:, c], 0.0) / problem.sigma[:, c]
                    shares[points.runs[int(r)]] = float(m @ left) / square, square**-0.5
            if len(shares) > 1:
                found.append(_told(name, channel, shares))
    return found


def _told(propeller: str, channel: str, shares: dict[str, tuple[float, float]]) -> str:
    high = max(shares, key=lambda r: shares[r][0])
    low = min(shares, key=lambda r: shares[r][0])
    gap = shares[high][0] - shares[low][0]
    noise = float(np.hypot(shares[high][1], shares[low][1]))
    if gap < _MIN_SIGMAS * noise:
        return f"{len(shares)} runs of {propeller} agree within {100.0 * gap:.2g} % in {channel}"
    return (
        f"runs of {propeller} differ by {100.0 * gap:.2g} % in {channel}: {high} is "
        f"{100.0 * shares[high][0]:+.1f} % off the model, {low} {100.0 * shares[low][0]:+.1f} %"
    )
