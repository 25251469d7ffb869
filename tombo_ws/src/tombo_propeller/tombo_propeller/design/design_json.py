"""What `design.json` holds: plain values, units in the names, equal designs in equal bytes."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from tombo_dynamics.propeller import RPM
from tombo_flight.json_text import plain
from tombo_flight.version import tombo_version
from tombo_propeller.design import summary_text, table_cells
from tombo_propeller.design.candidates import describe, properties
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Check
from tombo_propeller.design.recommend import Recommendation
from tombo_propeller.design.request import MEASURED, QUANTITIES


def design_mapping(found: Design, made: Recommendation) -> dict[str, Any]:
    """Return the content of `design.json`; None for what is not known."""
    choice = found.choice
    mapping: dict[str, Any] = plain(
        {
            "headline": summary_text.headline(found, made),
            "feasible": found.feasible,
            "flies_as_claimed": None if made.check is None else made.check.held,
            "recommended": None if made.index is None else candidate(found, made.index),
            "reasons": summary_text.reasons(found, made),
            "must_give": [
                {
                    "limit": limit.text,
                    "quantity": limit.quantity.name,
                    "asked": limit.value,
                    "possible": value,
                }
                for limit, value in zip(choice.limits, choice.relief, strict=True)
            ]
            if not found.feasible
            else [],
            "must_give_text": summary_text.relief_lines(found),
            "check": _check(made.check),
            "check_at_upper_ends": _check(made.upper),
            "failed_in_flight": [
                {"candidate": candidate(found, i), "check": _check(c)} for i, c in made.failed
            ],
            "nearest_that_flies": None if made.instead is None else candidate(found, made.instead),
            "alternatives": [
                {**candidate(found, i), "why": why}
                for i, why in table_cells.alternatives(found, made)
            ],
            "measured": [
                candidate(found, i)
                for i in range(len(found.judged.configurations))
                if found.judged.tier[i] == 0
            ],
            "pareto": [candidate(found, i) for i in choice.order if choice.front[i]],
            "candidates": len(found.judged.configurations),
            "candidates_feasible": int(choice.feasible.sum()),
            "request": dataclasses.asdict(found.request),
            "limits": [limit.text for limit in choice.limits],
            "vehicle": dataclasses.asdict(found.vehicle),
            "tested": dataclasses.asdict(found.tested),
            "predictions": {name: _reading(found, name) for name in MEASURED},
            "thrust_error": found.thrust_error,
            "caveats": summary_text.caveats(found, made),
            "version": tombo_version(),
        }
    )
    return mapping


def candidate(found: Design, index: int) -> dict[str, Any]:
    """Return a candidate with its figures and how each is known."""
    judged = found.judged
    configuration = judged.configurations[index]
    nodus = configuration.nodus
    assert nodus is not None
    operating = judged.operating
    limits = zip(found.choice.limits, found.choice.slack[index], strict=True)
    return {
        "name": table_cells.name_of(found, index),
        "conf": configuration.number,
        "nodus": describe(configuration),
        "matrix": nodus.matrix.name,
        "fibre": nodus.fibre.name,
        **properties(configuration),
        "fibres": nodus.fibres,
        "fibre_diameter_mm": nodus.fibre_diameter_mm,
        "evidence": table_cells.EVIDENCE[int(judged.tier[index])],
        "outside_of_tests": list(judged.outside[index]),
        "hover_rpm": float(operating.hover_speed[index]) / RPM,
        "usable_rpm": float(operating.usable_speed[index]) / RPM,
        "usable_thrust_N": float(operating.usable_thrust[index]),
        "motor_limits_thrust": bool(operating.motor_limits[index]),
        "twist_in_hover_deg": math.degrees(float(operating.hover_twist[index])),
        "figures": {
            q.name: {
                "value": float(judged.value[index, k]),
                "low": float(judged.low[index, k]),
                "high": float(judged.high[index, k]),
                "counted": float(judged.counted[index, k]),
                "known": judged.labels[index][k],
            }
            for k, q in enumerate(QUANTITIES)
        },
        "slack": {limit.quantity.name: float(s) for limit, s in limits},
    }


def _check(check: Check | None) -> dict[str, Any] | None:
    if check is None:
        return None
    return {
        "held": check.held,
        "flights": len(check.seeds),
        "collision_force_N": check.force_N,
        "recovery_s": check.recovery_s,
        "largest_fall_m": check.falls_m,
        "longest_settling_s": check.settles_s,
        "limits": [dataclasses.asdict(limit) for limit in check.limits],
        "claims": [dataclasses.asdict(claim) for claim in check.claims],
    }


def _reading(found: Design, name: str) -> dict[str, Any]:
    reading = found.readings[name]
    return {
        "readings": reading.count,
        "used": reading.regressor,
        "mean": reading.mean,
        "left_out_error": reading.error,
        "left_out_error_of_mean": reading.mean_error,
        "regressors": {t.regressor: t.error for t in reading.trials},
        "chance": reading.chance,
        "rank_correlation_with_stiffness": reading.rank_correlation,
        "rank_correlation_chance": reading.rank_p_value,
        "text": summary_text.sources(found)[MEASURED.index(name)],
    }
