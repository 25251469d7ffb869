"""Causes of flights: parameters from fits of every kind, and the scores of all candidates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats
from scipy.linalg import block_diag

from tombo_diagnosis.diagnosis import Cause, Score
from tombo_diagnosis.engine import cause_estimates
from tombo_diagnosis.engine.cause_estimates import (
    TWO_SIDED,
    ParameterEstimate,
    as_tuples,
    detectable_changes,
    fitted_parameter,
    fitted_parameters,
)
from tombo_diagnosis.engine.model import Explanation
from tombo_diagnosis.flight.analyse import FlightAnalysis, mean_wind
from tombo_diagnosis.flight.fit.sensitivity import scatter_unit
from tombo_diagnosis.flight.fit.track import WIND
from tombo_diagnosis.flight.nominal import SCATTER
from tombo_diagnosis.flight.swing import swing_estimate
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.extended_model import FittedParameter

_SCALE_KG = 1e-3
"""kg: resolution of the scales of most labs."""
UNWEIGHED = 0.5
"""Confidence, at most, in a change of mass or balance that such a scale would not show. A cause
outside the candidates may have such a small effect."""


def estimate_cause(effect: str, findings: FlightAnalysis, explanation: Explanation) -> Cause:
    """Return a cause with its parameters, from the fit of an explanation or of random effects."""
    theta, covariance = fitted_parameters(findings.problem, explanation, effect)
    besides = [_noise_estimate(effect, findings)]
    if effect == WIND:
        besides.append(swing_estimate(findings.problem, *mean_wind(findings)))
    for estimate in besides:
        if estimate[0]:
            theta, covariance = _together((theta, covariance), estimate)
    if effect == SCATTER and not theta:
        theta, covariance = _scatter_estimate(findings, explanation)
    confidence = findings.judgement.each.get(effect, 0.0)
    if not shown_by_scale(effect, theta, findings.problem.nominal.vehicle):
        confidence = min(confidence, UNWEIGHED)
    return Cause(effect, theta, confidence, REGISTRY[effect].signature, covariance)


def shown_by_scale(effect: str, theta: Sequence[FittedParameter], vehicle: VehicleParams) -> bool:
    """Return whether a scale of 1 g shows a change of mass or balance; True for other effects.

    A centre of gravity moved by x shows as the mass m x / arm on a scale below one arm.
    """
    mass = vehicle.mass
    masses = {
        "mass_error": {"fraction": mass},
        "cog_offset": dict.fromkeys("xy", mass / vehicle.arm_length),
        "hanging_load": {"mass": 1.0},
    }.get(effect, {})
    shown = [abs(p.value - p.nominal) * masses[p.name] for p in theta if p.name in masses]
    return not shown or max(shown) >= _SCALE_KG


def _noise_estimate(effect: str, findings: FlightAnalysis) -> ParameterEstimate:
    """Return the parameters of a stochastic effect that what is left unexplained shows."""
    parameters = findings.problem.nominal.parameters
    rows: dict[int, tuple[float, float]] = {}
    for fit in findings.remainder.scatter:
        if fit.effect == effect:
            rows |= dict(zip(fit.free, zip(fit.value, fit.deviation, strict=True), strict=True))
    gusts = findings.remainder.gusts
    if effect == "gusts" and gusts is not None:
        places = {p.name: p.index for p in parameters if p.effect == effect}
        rows[places["deviation"]] = gusts.deviation, gusts.deviation_error
        rows[places["time"]] = gusts.time, gusts.time_error
    theta = findings.problem.theta
    rows = dict(sorted(rows.items()))
    fitted = tuple(fitted_parameter(parameters[i], float(theta[i]), *r) for i, r in rows.items())
    return fitted, as_tuples(np.diag([error**2 for _, error in rows.values()]))


def _together(a: ParameterEstimate, b: ParameterEstimate) -> ParameterEstimate:
    """Return both estimates of one effect; where both have a parameter, the second one."""
    names = {f.name for f in b[0]}
    kept = [k for k, f in enumerate(a[0]) if f.name not in names]
    first = np.reshape(a[1], (len(a[0]), len(a[0])))[np.ix_(kept, kept)]
    spread = block_diag(first, np.array(b[1]))
    return (*(a[0][k] for k in kept), *b[0]), as_tuples(spread)


def _scatter_estimate(findings: FlightAnalysis, explanation: Explanation) -> ParameterEstimate:
    """Return the scatter of the draws: their root mean square, with a chi-square interval."""
    problem = findings.problem
    p = problem.nominal.scatter
    drawn = explanation.fit.solution.mean[len(problem.unknowns.indices) :]
    unit = scatter_unit(problem.theta, problem.nominal)
    count = max(drawn.size, 1)
    value = min(unit * float(np.sqrt(np.mean(drawn**2))), p.high)
    low = value * math.sqrt(count / float(stats.chi2.ppf(0.975, count)))
    high = min(value * math.sqrt(count / float(stats.chi2.ppf(0.025, count))), p.high)
    variance = ((high - low) / (2.0 * TWO_SIDED)) ** 2
    nominal = float(problem.theta[p.index])
    return (FittedParameter(p.name, p.unit, nominal, value, low, high),), ((variance,),)


def scores(
    findings: FlightAnalysis, gains: dict[str, float], refused: Mapping[str, str]
) -> tuple[Score, ...]:
    """Return all effects of the registry, most probable first.

    `gains`: effect -> share of the excess that it removes in held-out flights; `refused`: effect
    -> what in held-out flights speaks against it.
    """
    nominal, remainder = findings.problem.nominal, findings.remainder
    log_bf = dict(findings.search.single_log_bf)
    for fit in remainder.all_noise_fits:
        log_bf[fit.effect] = max(log_bf.get(fit.effect, -math.inf), fit.evidence)
    if remainder.gusts is not None:
        log_bf["gusts"] = remainder.gusts.evidence
    elif not nominal.calibrated:
        log_bf.setdefault("gusts", 0.0)
    absorbed = {label.split(".")[0] for label in nominal.fitted}

    def why_not(effect: str) -> str:
        if effect in refused:
            return refused[effect]
        if effect in absorbed:
            return "taken up by the fit of the nominal model to the same flights"
        if REGISTRY[effect].contact:
            return "nothing was touched in the spans that count"
        if REGISTRY[effect].company:
            return "no other vehicle is known to have flown"
        return "these flights have no channel that shows it"

    problem = findings.problem
    least = detectable_changes(problem, problem.null_hypothesis)
    return cause_estimates.scores(log_bf, gains, REGISTRY, why_not, least)
