"""Claims about Tables I and III: what is printed there, computed again."""

from __future__ import annotations

from tombo_dynamics.propeller import configuration, nodus_moduli
from tombo_propeller.reproduce.claim import Claim, by_law, each, judge_of, verdicts
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper

_LAST_DIGIT = "to the last printed digit"


def table_1(paper: Paper, numbers: Numbers) -> Claim:
    """Moduli of the nodus, Eq. 2."""
    whole = 2 * len(paper.table_1)

    def same(law: LawNumbers) -> float:
        return sum(
            p.agrees(v)
            for conf, printed in paper.table_1.items()
            for p, v in zip(printed, law.moduli[conf], strict=True)
        )

    computed = by_law(numbers, same)
    shear = sum(p[1].agrees(numbers.shear_from_ratio[c]) for c, p in paper.table_1.items())
    own = {c: nodus_moduli(configuration(c)).G_N_MPa for c in paper.table_1}
    ours = sum(p[1].agrees(own[c]) for c, p in paper.table_1.items())
    return Claim(
        name="table_1",
        group="Moduli",
        kind="printed",
        claim="E_N and G_N of every configuration follow from Eq. 2",
        source="Table I",
        paper=f"{whole} values",
        quantity=f"printed values met, of {whole}",
        unit="1",
        computed=computed,
        tolerance=_LAST_DIGIT,
        verdicts=verdicts(computed, lambda n: n == whole),
        judge=judge_of(numbers, "repaired"),
        evidence=f"G_f is not printed: {numbers.fibre_shear_MPa:g} MPa meets {ours} of "
        f"{len(paper.table_1)} G_N, E_f / 2.7 of the authors' program {shear}; that program "
        "also takes 6 fibres whatever the table says.",
    )


def table_3_ratio(paper: Paper, numbers: Numbers) -> Claim:
    """The simulated column of Table III."""
    whole = len(paper.table_3)
    computed = by_law(
        numbers,
        lambda law: sum(r.ratio.agrees(law.low[c].ratio) for c, r in paper.table_3.items()),
    )
    softest = min(c for c in paper.table_3 if c)
    return Claim(
        name="table_3_lift_over_drag",
        group="Lift over drag",
        kind="printed",
        claim="Lift over drag of ten propellers at 2000 rpm",
        source="Table III",
        paper=f"{whole} values",
        quantity=f"printed values met, of {whole}",
        unit="1",
        computed=computed,
        tolerance=_LAST_DIGIT,
        verdicts=verdicts(computed, lambda n: n == whole),
        judge=judge_of(numbers),
        evidence=f"Conf. {softest}, printed as {paper.table_3[softest].ratio.text}, computed "
        f"{each(by_law(numbers, lambda law: law.low[softest].ratio), '{:.4f}')}.",
    )


def table_3_fibres(paper: Paper, numbers: Numbers) -> Claim:
    """Whether the propellers of the two tables are the same."""
    whole = len(paper.table_3)
    computed = by_law(
        numbers,
        lambda law: sum(r.ratio.agrees(law.table_1_ratio[c]) for c, r in paper.table_3.items()),
    )
    judge = judge_of(numbers)
    ratios = numbers.laws[judge].table_1_ratio
    met = ", ".join(str(c) for c, r in paper.table_3.items() if r.ratio.agrees(ratios[c]))
    return Claim(
        name="table_3_fibres",
        group="Lift over drag",
        kind="check",
        claim="Table III was simulated for the propellers of Table I",
        source="Tables I and III",
        paper="5 fibres in Conf. 5–13",
        quantity=f"printed L/D met with Table I's fibres, of {whole}",
        unit="1",
        computed=computed,
        tolerance=_LAST_DIGIT,
        verdicts=verdicts(computed, lambda n: n == whole),
        judge=judge_of(numbers),
        evidence=f"With the fibres of Table I only Conf. {met or 'none'} comes out as printed "
        f"(law {judge}); the authors' program always takes 6 fibres.",
    )


def soft_ratio(paper: Paper, numbers: Numbers) -> Claim:
    """Soft propellers are said to be more efficient."""
    soft = [c for c in paper.table_3 if c]
    computed = by_law(numbers, lambda law: sum(law.low[c].ratio > law.low[0].ratio for c in soft))
    gain = by_law(
        numbers, lambda law: 100.0 * max(law.low[c].ratio / law.low[0].ratio - 1.0 for c in soft)
    )
    return Claim(
        name="soft_lift_over_drag",
        group="Lift over drag",
        kind="printed",
        claim="Every Tombo propeller has more lift over drag than the rigid one",
        source="Table III",
        paper=f"{len(soft)} of {len(soft)}",
        quantity="soft configurations above the rigid one at 2000 rpm",
        unit="1",
        computed=computed,
        tolerance="all",
        verdicts=verdicts(computed, lambda n: n == len(soft)),
        judge=judge_of(numbers),
        evidence=f"The largest gain is {each(gain, '{:.1f} %')}; a result of the coefficients "
        "alone, since neither drag nor torque was measured.",
    )


TABLE_CLAIMS = (table_1, table_3_ratio, table_3_fibres, soft_ratio)
