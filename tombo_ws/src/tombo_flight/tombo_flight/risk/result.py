"""What a study of risk answers, as plain values, and which inputs decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_flight.campaign.statistics import exact_interval
from tombo_flight.risk.estimate import FlightSample, RiskEstimate, agree
from tombo_flight.risk.study import RiskStudy, openturns, settings_at

_DEGREES = (1, 2, 3)
_FOLDS = 10


def influence(keys: Sequence[str], sample: FlightSample) -> dict[str, Any] | None:
    """Return first-order and total Sobol indices of the margin, for inputs as given; None: none.

    A polynomial chaos expansion is fitted to the flights; its indices are exact sums of squared
    coefficients (Sudret 2008). The degree is the one that predicts flights best that it was not
    fitted to; `r2` is the share of the margin's variance that it predicts of these. The rest comes
    from the flights' own draws (sensor noise, gusts, scatter) and from what no such polynomial
    shows.
    """
    if not keys:
        return None
    y, weights = sample.margins, np.sqrt(sample.weights)
    fits = []
    for degree in _DEGREES:
        terms, orders = _chaos_terms(sample.points, degree)
        if degree == 1 or terms.shape[1] * _FOLDS <= y.size:
            fits.append((_r2(terms, y, weights), degree, terms, orders))
    r2, degree, terms, orders = max(fits, key=lambda fit: fit[:2])
    known = {
        "of": "margin of a flight, inputs as given",
        "by": f"OpenTURNS, polynomial chaos of degree {degree} in the normalised inputs",
        "r2": r2,
    }
    if r2 <= 0.0:
        return {**known, "indices": []}
    first, total = sobol_indices(_fit(terms, y, weights), orders)
    rows = [
        {"key": key, "first": float(a), "total": float(b)}
        for key, a, b in zip(keys, first, total, strict=True)
    ]
    return {**known, "indices": sorted(rows, key=lambda row: -row["total"])}


def _chaos_terms(points: Array, degree: int) -> tuple[Array, NDArray[np.int64]]:
    """Return products of orthonormal Hermite polynomials of the inputs up to a degree.

    Args:
        points: (N, d) standard normal numbers.
        degree: of the products.

    Returns:
        their values (N, terms), and the order in each input (terms, d).
    """
    ot = openturns()
    count = points.shape[1]
    basis = ot.OrthogonalProductPolynomialFactory([ot.HermiteFactory()] * count)
    numbering = basis.getEnumerateFunction()
    terms = range(numbering.getBasisSizeFromTotalDegree(degree))
    sample = ot.Sample(points)
    values = [np.asarray(basis.build(term)(sample))[:, 0] for term in terms]
    return np.column_stack(values), np.array([list(numbering(term)) for term in terms])


def sobol_indices(coefficients: Array, orders: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return first-order and total Sobol indices (d,) of a polynomial chaos expansion.

    Args:
        coefficients: (terms,).
        orders: of each term in each input (terms, d).
    """
    variances = coefficients**2 * orders.any(axis=1)
    active = orders > 0
    alone = active & (active.sum(axis=1) == 1)[:, None]
    return variances @ alone / variances.sum(), variances @ active / variances.sum()


def _fit(x: Array, y: Array, weights: Array) -> Array:
    solution: Any = np.linalg.lstsq(x * weights[:, None], y * weights, rcond=None)[0]
    return np.asarray(solution, dtype=np.float64)


def _r2(x: Array, y: Array, weights: Array) -> float:
    """Return the share of the variance that is predicted, by cross-validation."""
    fold = np.arange(y.size) % _FOLDS
    error = np.zeros(y.size)
    for left_out in range(_FOLDS):
        out = fold == left_out
        error[out] = y[out] - x[out] @ _fit(x[~out], y[~out], weights[~out])
    share = weights**2 / (weights**2).sum()
    variance = share @ (y - share @ y) ** 2
    return float(1.0 - share @ error**2 / variance) if variance > 0.0 else 0.0


CONFIDENCE = 0.95


def result_of(
    study: RiskStudy,
    answer: RiskEstimate,
    sample: FlightSample,
    errors: Sequence[str],
    decides: Mapping[str, Any] | None,
    check: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Return the answer, what it rests on, and the most likely crash.

    Args:
        study: the question.
        answer: of `estimate`.
        sample: its flights.
        errors: of flights that could not be flown.
        decides: of `influence`.
        check: of `check_of`.
    """
    crashed = sample.margins < 0.0
    given, hits = int(sample.as_given.sum()), int((crashed & sample.as_given).sum())
    return {
        "scenario": study.label,
        "probability": answer.probability,
        "low": answer.low,
        "high": answer.high,
        "confidence": CONFIDENCE,
        "flights": sample.margins.size,
        "method": answer.method,
        "flights_of_estimate": sample.margins.size - sample.first,
        "crashes_of_estimate": int(crashed[sample.first :].sum()),
        "drawn_as_given": {"flights": given, "crashed": hits, "high": _high(hits, given)},
        "not_flown": {"flights": len(errors), "first": errors[0] if errors else None},
        "inputs": [
            {"key": setting.key, "distribution": setting.distribution, "source": setting.source}
            for setting in study.inputs
        ],
        "most_likely_crash": _most_likely(study, sample),
        "crashes": _crashes(study, sample),
        "influence": decides,
        "check": check,
        "outcome": outcome_of(answer, check),
        "tombo_version": study.tombo_version,
    }


def check_of(answer: RiskEstimate, plain: RiskEstimate, sample: FlightSample) -> dict[str, Any]:
    """Return what plain Monte Carlo says of an answer.

    Args:
        answer: what is checked.
        plain: what the check's flights say.
        sample: these flights.
    """
    ratio = None
    if answer.probability is not None and plain.probability is not None:
        ratio = answer.probability / plain.probability
    return {
        "flights": sample.margins.size,
        "crashes": int((sample.margins < 0.0).sum()),
        "probability": plain.probability,
        "low": plain.low,
        "high": plain.high,
        "ratio": ratio,
        "agrees": agree(answer, plain),
    }


def outcome_of(answer: RiskEstimate, check: Mapping[str, Any] | None = None) -> str:
    """Return the answer in a line."""
    said = ""
    if check is not None:
        verdict = "agrees" if check["agrees"] else "differs"
        said = f"; plain Monte Carlo of {check['flights']} flights {verdict}"
    if answer.probability is None:
        return f"no crash found, probability below {answer.high:.2g}{said}"
    found = f"{answer.probability:.3g} ({answer.low:.2g} to {answer.high:.2g})"
    return f"crash probability {found}{said}"


def _high(crashed: int, of: int) -> float:
    return exact_interval(crashed, of)[1] if of else 1.0


def _most_likely(study: RiskStudy, sample: FlightSample) -> dict[str, Any] | None:
    """Return the crash whose inputs are nearest to the usual ones; None: there is none."""
    crashed = np.flatnonzero(sample.margins < 0.0)
    if not crashed.size:
        return None
    distance = np.sqrt((sample.points[crashed] ** 2).sum(axis=1))
    row = int(crashed[np.argmin(distance)])
    point, seed = sample.points[row], int(sample.seeds[row])
    texts = settings_at(study.inputs, point)
    return {
        "flight": row,
        "seed": seed,
        "inputs": {key: float(value) for key, _, value in (t.partition("=") for t in texts)},
        "deviations": {
            setting.key: float(u) for setting, u in zip(study.inputs, point, strict=True)
        },
        "distance": float(distance.min()),
        "margin": float(sample.margins[row]),
        "command": study.command(point, seed),
    }


def _crashes(study: RiskStudy, sample: FlightSample) -> list[dict[str, Any]]:
    """Return where the crashes are: each input's mean over them, as often as they occur."""
    crashed = sample.margins < 0.0
    if not crashed.any():
        return []
    weights = sample.weights[crashed] / sample.weights[crashed].sum()
    mean = weights @ sample.points[crashed]
    texts = settings_at(study.inputs, mean)
    rows = [
        {"key": setting.key, "value": float(text.partition("=")[2]), "deviations": float(u)}
        for setting, text, u in zip(study.inputs, texts, mean, strict=True)
    ]
    return sorted(rows, key=lambda row: -abs(float(str(row["deviations"]))))
