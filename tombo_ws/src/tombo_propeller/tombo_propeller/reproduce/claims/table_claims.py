"""Claims about Tables I and III: what is printed there, computed again."""

from __future__ import annotations

from tombo_dynamics.propeller import configuration, nodus_moduli
from tombo_propeller.reproduce.claims.claim import (
    ClaimOutcome,
    by_law,
    judge_of,
    judges,
    of_laws,
    per_law,
)
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper


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
