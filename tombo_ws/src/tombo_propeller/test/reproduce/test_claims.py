"""Every verdict follows from numbers: change one, and the verdict changes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from tombo_propeller.reproduce.claims.claim import DATA, FAILS, HOLDS, JUDGES, OPEN
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper, PrintedNumber, Row3
from tombo_propeller.reproduce.reproduction import Reproduction, reproduce


@pytest.fixture(scope="module")
def whole() -> Reproduction:
    return reproduce()


EXPECTED = {
    HOLDS: """table_1 table_3_lift_over_drag soft_lift_over_drag eps_mld eps_mld_same gamma_mld
        rigid_lift_over_drag omega_mtf_order gamma_mtf universal_curve mean_recovery_time
        response_point recovery_phases falling_distance""",
    FAILS: """table_3_fibres hover thrust_error_table_3 thrust_within_deviation better_than_mean
        beta_reading collision_force collision_force_over_radius response_equation""",
    OPEN: """curves thrust_error centrifugal_stiffening thrust_follows_stiffness
        collision_force_tables endurance noise recovers crashes_without_reaction""",
}
"""The laws under which they stand are in docs/reproduction.md."""


def test_verdict_of_every_claim(whole: Reproduction) -> None:
    for verdict, names in EXPECTED.items():
        assert {c.name for c in whole.claims if c.verdict == verdict} == set(names.split())
    assert set(JUDGES) == {c.name for c in whole.claims}


def test_the_papers_tables_to_the_last_digit(whole: Reproduction) -> None:
    assert whole.claim("table_1").computed == {"published": 5, "repaired": 26, "consistent": 26}
    ratio = whole.claim("table_3_lift_over_drag").computed
    assert ratio == {"published": 10, "repaired": 1, "consistent": 1}
    assert whole.claim("eps_mld").computed["published"] == pytest.approx(2.1716, abs=5e-5)
    assert whole.claim("mean_recovery_time").computed[DATA] == pytest.approx(4.14 / 9)
    assert whole.claim("response_point").computed[DATA] == pytest.approx(math.hypot(0.8, 0.2))
    assert whole.claim("collision_force").computed[DATA] == pytest.approx(189.9 / 269.3)


Change = Callable[[Paper, Numbers], tuple[Paper, Numbers]]


def in_table_3(**fields: Callable[[Row3], object]) -> Change:
    def change(paper: Paper, numbers: Numbers) -> tuple[Paper, Numbers]:
        rows = {
            c: replace(row, **{k: PrintedNumber(str(f(row))) for k, f in fields.items()})
            for c, row in paper.table_3.items()
        }
        return replace(paper, table_3=rows), numbers

    return change


def one_row(conf: int, **texts: str) -> Change:
    def change(paper: Paper, numbers: Numbers) -> tuple[Paper, Numbers]:
        row = replace(paper.table_3[conf], **{k: PrintedNumber(t) for k, t in texts.items()})
        return replace(paper, table_3={**paper.table_3, conf: row}), numbers

    return change


def printed(section: str, name: str, text: Any) -> Change:
    def change(paper: Paper, numbers: Numbers) -> tuple[Paper, Numbers]:
        entry = paper.texts[section][name]
        new = {**entry, "printed": text} if isinstance(entry, dict) else text
        inside = {**paper.texts[section], name: new}
        return replace(paper, texts={**paper.texts, section: inside}), numbers

    return change


def computed(edit: Callable[[LawNumbers], dict[str, Any]]) -> Change:
    def change(paper: Paper, numbers: Numbers) -> tuple[Paper, Numbers]:
        laws = {name: replace(law, **edit(law)) for name, law in numbers.laws.items()}
        return paper, replace(numbers, laws=laws)

    return change


def first_modulus(paper: Paper, numbers: Numbers) -> tuple[Paper, Numbers]:
    changed = {**paper.table_1, 1: (PrintedNumber("0.1543"), paper.table_1[1][1])}
    return replace(paper, table_1=changed), numbers


def force_at_50_mm(text: str) -> Change:
    def change(paper: Paper, numbers: Numbers) -> tuple[Paper, Numbers]:
        first, *rest = paper.table_2
        return replace(
            paper, table_2=(replace(first, force_N=PrintedNumber(text)), *rest)
        ), numbers

    return change


def optimum(which: str, conf: int, **fields: float) -> Change:
    def edit(law: LawNumbers) -> dict[str, Any]:
        reproduction = dict(getattr(law, which))
        reproduction[conf] = replace(reproduction[conf], **fields)
        return {which: reproduction}

    return computed(edit)


def point(conf: int, **fields: float) -> Callable[[LawNumbers], dict[str, Any]]:
    return lambda law: {"low": {**law.low, conf: replace(law.low[conf], **fields)}}


def as_measured(paper: Paper, numbers: Numbers) -> tuple[Paper, Numbers]:
    """Let every law compute what was measured, within a millinewton."""
    laws = {}
    for name, law in numbers.laws.items():
        low = {
            c: replace(p, thrust_N=paper.table_3[c].thrust_N.value + 0.001)
            if c in paper.table_3
            else p
            for c, p in law.low.items()
        }
        laws[name] = replace(law, low=low)
    return paper, replace(numbers, laws=laws)


def ranked(paper: Paper, numbers: Numbers) -> tuple[Paper, Numbers]:
    """Let measured thrusts be those of law repaired."""
    low = numbers.laws["repaired"].low
    rows = {
        c: replace(row, thrust_N=PrintedNumber(f"{low[c].thrust_N:.6f}"))
        for c, row in paper.table_3.items()
    }
    return replace(paper, table_3=rows), numbers


def no_lag(law: LawNumbers) -> dict[str, Any]:
    return {
        name: {c: replace(p, alpha_deg=0.0) for c, p in getattr(law, name).items()}
        for name in ("low", "high")
    }


MUTATIONS: list[tuple[str, Change, str]] = [
    ("table_1", first_modulus, FAILS),
    ("table_3_lift_over_drag", one_row(12, ratio="1.8991"), FAILS),
    ("table_3_fibres", computed(lambda law: {
        "table_1_ratio": {c: p.ratio for c, p in law.low.items()}}), HOLDS),
    ("soft_lift_over_drag", computed(point(13, ratio=1.7)), FAILS),
    ("eps_mld", printed("model", "largest_lift_over_drag", "2.18"), FAILS),
    ("eps_mld", optimum("ratio", 7, value=2.176), FAILS),
    ("eps_mld_same", optimum("ratio", 7, value=2.16), FAILS),
    ("gamma_mld", optimum("ratio", 7, gamma_deg=9.3), FAILS),
    ("gamma_mtf", optimum("thrust", 3, gamma_deg=16.2), FAILS),
    ("omega_mtf_order", optimum("thrust", 2, speed_rpm=12000.0), FAILS),
    ("rigid_lift_over_drag", computed(lambda law: {"rigid_ratio_spread": 1e-6}), FAILS),
    ("universal_curve", computed(lambda law: {"collapse": 1e-6}), FAILS),
    ("hover", computed(lambda law: {
        "thrust": {c: replace(o, value=5.0) for c, o in law.thrust.items()}}), HOLDS),
    ("thrust_error", one_row(0, thrust_N="0.70"), FAILS),
    ("thrust_error", printed("model", "thrust_configurations", ["0"]), HOLDS),
    ("thrust_error_table_3", as_measured, HOLDS),
    ("thrust_error_table_3", printed("model", "thrust_error_percent", "18"), HOLDS),
    ("thrust_within_deviation", as_measured, HOLDS),
    ("better_than_mean", as_measured, HOLDS),
    ("thrust_follows_stiffness", ranked, HOLDS),
    ("thrust_follows_stiffness", in_table_3(
        thrust_dev_N=lambda row: 0.001), FAILS),
    ("beta_reading", computed(no_lag), HOLDS),
    ("collision_force", one_row(12, force_N="179.5"), HOLDS),
    ("collision_force", printed("measured", "force_share_of_rigid", "3/4"), HOLDS),
    ("collision_force_over_radius", force_at_50_mm("340.0"), HOLDS),
    ("collision_force_tables", one_row(13, force_N="20.0"), FAILS),
    ("mean_recovery_time", one_row(5, recovery_s="0.73"), FAILS),
    ("mean_recovery_time", printed("measured", "mean_recovery_s", "0.47"), FAILS),
    ("endurance", printed("measured", "replaced", "2"), FAILS),
    ("noise", in_table_3(
        noise_dB=lambda row: row.noise_dB.value + 3.0 * (row.recovery_s is not None)), FAILS),
    ("response_point", printed("flight", "response_point_m", ["0.9", "0.4", "2.0"]), FAILS),
    ("response_equation", printed(
        "program", "response_point_m", ["0.908", "-0.011", "1.99"]), HOLDS),
    ("recovery_phases", printed("flight", "recovery_s", "3.4"), FAILS),
    ("falling_distance", printed("flight", "falls_m", "0.7"), FAILS),
    ("recovers", printed("campaign", "recovered", "40"), FAILS),
    ("crashes_without_reaction", printed("campaign", "crashed_without_reaction", "10"), FAILS),
]  # fmt: skip


@pytest.mark.parametrize(("name", "change", "after"), MUTATIONS)
def test_a_changed_number_changes_the_verdict(
    whole: Reproduction, name: str, change: Change, after: str
) -> None:
    assert whole.claim(name).verdict != after
    assert Reproduction(*change(whole.paper, whole.numbers)).claim(name).verdict == after


def test_only_two_verdicts_do_not_depend_on_numbers() -> None:
    never = {"curves", "centrifugal_stiffening"}
    assert set(JUDGES) - {name for name, *_ in MUTATIONS} == never


def test_a_claim_about_the_model_is_judged_by_the_law_that_was_asked_for() -> None:
    reproduction = reproduce(("repaired",))
    assert (reproduction.claim("eps_mld").verdict, reproduction.claim("eps_mld").law) == (
        FAILS,
        "repaired",
    )
    assert reproduction.claim("gamma_mtf").verdict == HOLDS
    none = reproduce(("consistent",))
    for name in ("omega_mtf_order", "gamma_mtf", "gamma_mld", "eps_mld_same"):
        assert none.claim(name).verdict == FAILS
        assert none.claim(name).computed == {"consistent": None}
