"""A stand diagnosis in words: the verdict with its figures, and its limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tombo_diagnosis.stand.analyse import StandAnalysis
from tombo_diagnosis.stand.problem import StandProblem
from tombo_diagnosis.stand.tables.operating_points import UNITS
from tombo_diagnosis.stand.thrust_constant import ThrustConstant
from tombo_diagnosis.wording import counted, display_name
from tombo_flight.extended_model import Gain


def summary(
    findings: StandAnalysis, gains: Sequence[Gain], constant: ThrustConstant | None = None
) -> str:
    """Return the verdict in a sentence or two."""
    judgement, best = findings.judgement, findings.search.best
    points = findings.problem.points
    runs, propellers = (
        counted(len(points.runs), "run"),
        counted(len(points.propellers), "propeller"),
    )
    data = f"{findings.problem.used} points of {runs}, {propellers}"
    names = ", ".join(map(display_name, judgement.effects))
    worth = "; ".join(
        f"{g.channel} {g.before:.3g} to {g.after:.3g} {g.unit}"
        for g in gains
        if g.after < g.before
    )
    worth = f" Error on points held out: {worth}." if worth and judgement.effects else ""
    curves = findings.remainder.curves
    unit = UNITS.get(curves.channel, "")
    text = {
        "none": f"{data} agree with the model within noise and tolerances.",
        "unknown": f"{data} differ from the model in a way that no effect of the registry "
        f"explains; free curves find {curves.size:.2g} {unit} more in {curves.channel}.",
        "named": f"{data} call for {names} (log Bayes factor {best.evidence:.0f}).{worth}",
        "set": f"{data} call for one of {names}, and can't tell which.{worth}",
        "partly_explained": f"{data} call for {names}, but free curves find "
        f"{curves.size:.2g} {unit} RMS more in {curves.channel}.{worth}",
    }[judgement.verdict]
    if judgement.verdict == "named" and judgement.members:
        members = ", ".join(map(display_name, judgement.members))
        text += f" Besides it is one of {members}."
    if constant is not None:
        k = constant
        text = (
            f"k_T = {k.k_T:.4g} N s^2 by rotor ({k.low:.4g} to {k.high:.4g}); "
            f"thrust grows with speed to the power {k.exponent:.2f}. {text}"
        )
    return text


def notes(findings: StandAnalysis, constant: ThrustConstant | None = None) -> tuple[str, ...]:
    """Return the limits of the diagnosis, and why."""
    problem, points = findings.problem, findings.problem.points
    lines: list[str] = []
    if constant is not None:
        lines.append(
            "k_T takes up everything that is a share of thrust at all speeds: coefficient, air "
            "density, the cell's gain, a wrong rpm scale can't be told from it with this file"
        )
    if problem.repeated:
        lines += repeats(problem)
    else:
        lines.append("no propeller has two runs: what differs from day to day is not seen")
    if len(points.propellers) < 3 and not points.setup.plain:
        lines.append(
            "fewer than three propellers: scatter of fabrication looks like a coefficient"
        )
    lacking = [c for k, c in enumerate(UNITS) if k not in points.measured and c != "beta"]
    if "torque" in lacking:
        lines.append(
            "no torque: coefficient, density, gain and rpm scale look alike in thrust alone"
        )
    return tuple(lines)


def repeats(problem: StandProblem) -> list[str]:
    """Return, for each propeller with several runs, the share by which they differ, in words.

    Of each run the share by which its load is off the model's, weighted least squares.
    """
    points, setup = problem.points, problem.points.setup
    model = problem.prediction(problem.theta)
    lines = []
    for p, name in enumerate(points.propellers):
        for c, channel in enumerate(("thrust", "torque")):
            shares: dict[str, float] = {}
            for r in np.unique(setup.run[setup.propeller == p]):
                rows = problem.seen[:, c] & (setup.run == r) & (setup.propeller == p)
                rows &= setup.speed > 0.0
                m, left = (x[rows, c] / problem.sigma[rows, c] for x in (model, problem.left))
                if m.any():
                    shares[points.runs[int(r)]] = 100.0 * float(m @ left) / float(m @ m)
            if len(shares) > 1:
                off = ", ".join(f"{run} {share:+.1f} %" for run, share in shares.items())
                gap = max(shares.values()) - min(shares.values())
                lines.append(
                    f"runs of {name} differ by {gap:.2g} % in {channel}; off the model: {off}"
                )
    return lines
