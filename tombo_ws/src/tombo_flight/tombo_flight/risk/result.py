"""What a study of risk answers, as plain values: the content of `--json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tombo_flight.campaign.statistics import exact_interval
from tombo_flight.risk.estimate import Estimate, Sample
from tombo_flight.risk.inputs import settings_at
from tombo_flight.risk.study import RiskStudy

CONFIDENCE = 0.95


def result_of(
    study: RiskStudy,
    answer: Estimate,
    sample: Sample,
    errors: Sequence[str],
    decides: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Return the answer, what it rests on, and the most likely crash.

    Args:
        study: the question.
        answer: of `estimate`.
        sample: its flights.
        errors: of flights that could not be flown.
        decides: of `influence`.
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
            {"key": one.key, "distribution": one.distribution, "source": one.source}
            for one in study.inputs
        ],
        "most_likely_crash": _most_likely(study, sample),
        "crashes": _crashes(study, sample),
        "influence": decides,
        "outcome": outcome_of(answer),
        "tombo_version": study.tombo_version,
    }


def outcome_of(answer: Estimate) -> str:
    """Return the answer in a line."""
    if answer.probability is None:
        return f"no crash found, probability below {answer.high:.2g}"
    return f"crash probability {answer.probability:.3g} ({answer.low:.2g} to {answer.high:.2g})"


def _high(crashed: int, of: int) -> float:
    return exact_interval(crashed, of)[1] if of else 1.0


def _most_likely(study: RiskStudy, sample: Sample) -> dict[str, Any] | None:
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
        "deviations": {one.key: float(u) for one, u in zip(study.inputs, point, strict=True)},
        "distance": float(distance.min()),
        "margin": float(sample.margins[row]),
        "command": study.command(point, seed),
    }


def _crashes(study: RiskStudy, sample: Sample) -> list[dict[str, Any]]:
    """Return where the crashes are: each input's mean over them, as often as they occur."""
    crashed = sample.margins < 0.0
    if not crashed.any():
        return []
    weights = sample.weights[crashed] / sample.weights[crashed].sum()
    mean = weights @ sample.points[crashed]
    texts = settings_at(study.inputs, mean)
    rows = [
        {"key": one.key, "value": float(text.partition("=")[2]), "deviations": float(u)}
        for one, text, u in zip(study.inputs, texts, mean, strict=True)
    ]
    return sorted(rows, key=lambda row: -abs(float(str(row["deviations"]))))
