"""Claims about printed numbers: Tables I and III, thrust, and the reading of the deformation."""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.propeller import configuration, nodus_moduli
from tombo_propeller.reproduce.claims.claim import (
    FAILS,
    OPEN,
    ClaimOutcome,
    Verdict,
    by_law,
    holds_if,
    judge_of,
    judges,
    of_laws,
    per_law,
)
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper

READING_DEG = 0.5


@judges
def table_1(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the moduli of the nodus, Eq. 2."""
    whole = 2 * len(paper.table_1)

    def same(law: LawNumbers) -> float:
        return sum(
            p.agrees(v)
            for conf, printed in paper.table_1.items()
            for p, v in zip(printed, law.moduli[conf], strict=True)
        )

    shear = sum(p[1].agrees(numbers.shear_from_ratio[c]) for c, p in paper.table_1.items())
    own = {c: nodus_moduli(configuration(c)).G_N_MPa for c in paper.table_1}
    ours = sum(p[1].agrees(own[c]) for c, p in paper.table_1.items())
    return of_laws(
        numbers,
        by_law(numbers, same),
        lambda n: n == whole,
        f"G_f is not printed: {numbers.fibre_shear_MPa:g} MPa meets {ours} of "
        f"{len(paper.table_1)} G_N, E_f / 2.7 of the authors' program {shear}; that program also "
        "takes 6 fibres whatever the table says.",
        law="repaired",
        whole=whole,
    )


@judges
def table_3_lift_over_drag(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the simulated column of Table III."""
    whole = len(paper.table_3)
    softest = min(c for c in paper.table_3 if c)
    ratio = by_law(numbers, lambda law: law.low[softest].ratio)
    return of_laws(
        numbers,
        by_law(
            numbers,
            lambda law: sum(r.ratio.agrees(law.low[c].ratio) for c, r in paper.table_3.items()),
        ),
        lambda n: n == whole,
        f"Conf. {softest}, printed as {paper.table_3[softest].ratio.text}, computed "
        f"{per_law(ratio, '{:.4f}')}.",
        whole=whole,
    )


@judges
def table_3_fibres(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether the propellers of Table III are those of Table I."""
    whole = len(paper.table_3)

    def met(law: LawNumbers) -> list[int]:
        return [c for c, r in paper.table_3.items() if r.ratio.agrees(law.table_1_ratio[c])]

    judge = judge_of(numbers)
    confs = ", ".join(map(str, met(numbers.laws[judge])))
    return of_laws(
        numbers,
        by_law(numbers, lambda law: len(met(law))),
        lambda n: n == whole,
        f"With the fibres of Table I only Conf. {confs or 'none'} comes out as printed (law "
        f"{judge}); the authors' program always takes 6 fibres.",
        whole=whole,
    )


@judges
def soft_lift_over_drag(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether soft propellers are more efficient."""
    soft = [c for c in paper.table_3 if c]
    gain = by_law(
        numbers, lambda law: 100.0 * max(law.low[c].ratio / law.low[0].ratio - 1.0 for c in soft)
    )
    return of_laws(
        numbers,
        by_law(numbers, lambda law: sum(law.low[c].ratio > law.low[0].ratio for c in soft)),
        lambda n: n == len(soft),
        f"The largest gain is {per_law(gain, '{:.1f} %')}; a result of the coefficients alone, "
        "since neither drag nor torque was measured.",
        soft=len(soft),
    )


def error_percent(paper: Paper, law: LawNumbers, conf: int) -> float:
    """Return how far computed thrust is from the measured one at 2000 rpm [%]."""
    return 100.0 * (law.low[conf].thrust_N / paper.table_3[conf].thrust_N.value - 1.0)


@judges
def thrust_error(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the bound of 8 %, where the paper claims it."""
    bound = paper.number("model", "thrust_error_percent").value
    claimed = [int(c) for c in paper.texts["model"]["thrust_configurations"]]
    known = [c for c in claimed if c in paper.table_3]

    def worst(law: LawNumbers) -> float | None:
        return max((error_percent(paper, law, c) for c in known), key=abs, default=None)

    def verdict(error: float | None) -> Verdict:
        if error is not None and abs(error) >= bound:
            return FAILS
        return OPEN if len(known) < len(claimed) else holds_if(error is not None)

    computed = by_law(numbers, worst)
    return of_laws(
        numbers,
        computed,
        {law: verdict(error) for law, error in computed.items()},
        f"Of {len(claimed)} propellers only Conf. {', '.join(map(str, known))} has a measured "
        "thrust in print, at one speed.",
        speeds=" to ".join(paper.texts["model"]["thrust_speeds_rpm"]),
    )


@judges
def thrust_error_table_3(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the same bound where thrusts are printed."""
    bound = paper.number("model", "thrust_error_percent").value
    soft = [c for c in paper.table_3 if c]
    errors = {
        name: {c: error_percent(paper, law, c) for c in soft} for name, law in numbers.laws.items()
    }
    worst = {name: max(by_conf, key=lambda c: abs(by_conf[c])) for name, by_conf in errors.items()}
    where = "; ".join(
        f"{name} {by_conf[worst[name]]:+.1f} % (Conf. {worst[name]}), "
        f"{sum(abs(e) < bound for e in by_conf.values())} of {len(soft)} within"
        for name, by_conf in errors.items()
    )
    return of_laws(
        numbers,
        {name: by_conf[worst[name]] for name, by_conf in errors.items()},
        lambda e: abs(e) < bound,
        f"Largest error: {where}.",
    )


@judges
def centrifugal_stiffening(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the paper's remark that the spinning propeller becomes stiff."""
    soft = [c for c in paper.table_3 if c]
    rigid = paper.table_3[0].thrust_N.value
    loss = 100.0 * (1.0 - float(np.mean([paper.table_3[c].thrust_N.value for c in soft])) / rigid)
    computed = by_law(numbers, lambda law: law.high[13].gamma_deg / law.low[13].gamma_deg)
    low, high = paper.texts["model"]["thrust_speeds_rpm"]
    return of_laws(
        numbers,
        computed,
        dict.fromkeys(numbers.laws, OPEN),
        f"In the laws the twist goes on growing ({per_law(computed, '× {:.2f}')}); measured "
        f"thrust is {loss:.1f} % below the rigid one's whatever the stiffness, as the sentence "
        "would have it, but neither twist nor torque was measured.",
        low=low,
        high=high,
    )


@judges
def beta_reading(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the formula with which the paper reads the flap from pictures."""

    def bias(law: LawNumbers) -> float:
        return max(
            (reading_deg(p.alpha_deg, p.beta_deg) - p.beta_deg
             for points in (law.low, law.high) for c, p in points.items() if c),
            key=abs,
        )  # fmt: skip

    computed = by_law(numbers, bias)
    return of_laws(
        numbers,
        computed,
        lambda e: abs(e) < READING_DEG,
        "Exact for flap alone, but lag shortens the diameter too; with the laws' α "
        f"{_thirteen(numbers)} at 2000 rpm, and the error "
        f"reaches {per_law(computed, '{:+.1f}°')}.",
        reading=f"{READING_DEG:g}",
    )


def reading_deg(alpha_deg: float, beta_deg: float) -> float:
    """Return what the paper's formula reads [deg] where a wing has lag and flap."""
    joint = configuration(13).blade
    inner, length = joint.joint.outer_radius_m, joint.tip_radius_m - joint.joint.outer_radius_m
    alpha, beta = math.radians(alpha_deg), math.radians(beta_deg)
    seen = math.hypot(
        inner + length * math.cos(alpha) * math.cos(beta),
        length * math.sin(alpha) * math.cos(beta),
    )
    return math.degrees(math.acos(max(-1.0, min(1.0, (seen - inner) / length))))


def _thirteen(numbers: Numbers) -> str:
    law = numbers.laws[judge_of(numbers)]
    point = law.low[13]
    read = reading_deg(point.alpha_deg, point.beta_deg)
    return f"Conf. 13 with β = {point.beta_deg:.1f}° reads {read:.1f}° (law {law.law})"
