"""The verdict, from findings made by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tombo_diagnosis.engine.model import Explanation, Hypothesis, SearchResult
from tombo_diagnosis.engine.model_selection import LOG_BF_ADDITIONAL, LOG_BF_FIRST
from tombo_diagnosis.engine.verdict import LOG_BF_DISTINCT, judge
from tombo_diagnosis.flight.analyse import (
    MAX_LOG_VARIANCE_EXCESS,
    ExplainedExcess,
    FlightRemainder,
    select_noise_fits,
    weigh_remainder,
)
from tombo_diagnosis.flight.fit.problem import SETTING
from tombo_diagnosis.flight.noise import NoiseFit
from tombo_diagnosis.flight.residual_check import GustFit, ResidualExcess, ScaleVariances

STRONG = 200.0 * LOG_BF_FIRST
PLAIN = 10.0 * LOG_BF_FIRST
NO_NOISE = -1.0
LOUD = MAX_LOG_VARIANCE_EXCESS + 3.0


def explanation(*effects, evidence=STRONG):
    return Explanation(tuple(Hypothesis(e, (k,)) for k, e in enumerate(effects)), None, evidence)


NOTHING = Explanation((), None, 0.0)


def searched(best=NOTHING, *alternatives):
    alone = {e.effects[0]: e.evidence for e in (best, *alternatives) if len(e.effects) == 1}
    return SearchResult(best, alone or {"wind": -2.0}, alternatives)


def left(excess):
    return [ResidualExcess("force x", "m/s^2", 0.5, 0.1, 0.05, excess), ResidualExcess(
        "force y", "m/s^2", 0.5, 0.05, 0.05, -2.0)]  # fmt: skip


def blown(evidence=STRONG, at_edge=False):
    return GustFit(0.7, 1.0, 0.1, 0.1, evidence, np.zeros(1), at_edge, True)


def noise(effect="imu_noise", evidence=STRONG, free=(3,)):
    return NoiseFit(effect, free, (0.02,), (0.001,), evidence)


def remainder(rest, noisy=(), gusts=None, residual_r2=0.0, explained=0.0):
    figures = FlightRemainder(
        False, 0.0, False, scatter=tuple(noisy), gusts=gusts,
        residual_excesses=tuple(rest), residual_r2=residual_r2,
        expected=ScaleVariances((), (), np.zeros((0, 0)), np.zeros((0, 0))),
    )  # fmt: skip
    share = ExplainedExcess(explained, explained, explained, frozenset({"force"}))
    return weigh_remainder(figures, share, thrust_fitted=False)


def judgement_of(result, excess=NO_NOISE, noisy=(), gusts=None, residual_r2=0.0, explained=1.0):
    return judge(SETTING, result, remainder(left(excess), noisy, gusts, residual_r2, explained))


@pytest.mark.parametrize(("excess", "verdict", "least"), [(NO_NOISE, "none", 0.8),
                                                          (LOUD, "unknown", 0.9)])  # fmt: skip
def test_without_a_cause_the_remainder_decides(excess, verdict, least):
    judgement = judgement_of(searched(), excess, explained=0.0)
    assert judgement.verdict == verdict and not judgement.effects and judgement.confidence > least


@pytest.mark.parametrize(
    ("evidence", "excess", "explained", "verdict"),
    [
        (STRONG, NO_NOISE, 1.0, "named"),
        (2 * LOG_BF_FIRST, LOUD, 0.0, "unknown"),
        (STRONG, LOUD, 0.4, "unknown"),
        (1000 * LOG_BF_FIRST, LOUD, 0.4, "unknown"),
        (2 * LOG_BF_FIRST, LOUD, 0.95, "unknown"),
        (STRONG, LOUD, 0.95, "partly_explained"),
    ],
)
def test_a_cause_is_named_if_it_leaves_little(evidence, excess, explained, verdict):
    """However high its evidence is: without this test an unknown force gets a name."""
    result = searched(explanation("wind", evidence=evidence))
    judgement = judgement_of(result, excess, explained=explained)
    assert judgement.verdict == verdict and not judgement.members
    assert judgement.effects == (() if verdict == "unknown" else ("wind",))
    assert verdict != "named" or min(judgement.confidence, judgement.each["wind"]) > 0.9


def test_what_is_left_where_no_cause_acts_is_no_veto():
    """Drag is not lost over a noisy gyro; it is not the whole story either."""
    rest = [ResidualExcess("gyro against mocap x", "rad/s", 0.5, 0.1, 0.05, LOUD), *left(NO_NOISE)]
    for evidence, verdict in ((STRONG, "partly_explained"), (1.2 * LOG_BF_FIRST, "unknown")):
        result = searched(explanation("wind", evidence=evidence))
        judgement = judge(SETTING, result, remainder(rest, explained=0.1))
        assert judgement.verdict == verdict
        assert judgement.effects == (("wind",) if verdict == "partly_explained" else ())


def test_effects_that_no_data_here_distinguish_are_one_set_whatever_their_evidence():
    pair = replace(SETTING, equivalent=(frozenset({"lever", "marker"}),), max_confidence=0.8)
    result = searched(explanation("wind", "lever"), explanation("wind", "marker", evidence=PLAIN))
    judgement = judge(pair, result, remainder(left(NO_NOISE), explained=1.0))
    assert (judgement.verdict, judgement.effects) == ("named", ("wind",))
    assert set(judgement.members) == {"lever", "marker"}
    alone = judge(pair, searched(explanation("marker")), remainder(left(NO_NOISE), explained=1.0))
    assert alone.verdict == "set" and set(alone.effects) == {"lever", "marker"}
    for each in (judgement, alone):
        assert max(each.confidence, *each.each.values()) <= 0.8


def test_causes_as_likely_as_each_other_are_a_set():
    close = explanation("tilt", evidence=PLAIN - 0.5 * LOG_BF_DISTINCT)
    far = explanation("drag", evidence=PLAIN - 3 * LOG_BF_DISTINCT)
    judgement = judgement_of(searched(explanation("wind", evidence=PLAIN), close, far))
    assert judgement.verdict == "set" and judgement.effects == judgement.members == (
        "wind",
        "tilt",
    )
    assert judgement.each["wind"] > judgement.each["tilt"] > 0.0


def test_rivals_just_behind_lower_the_confidence_of_a_named_cause():
    wind = explanation("wind", evidence=PLAIN)
    rivals = [explanation(e, evidence=PLAIN - 1.1 * LOG_BF_DISTINCT) for e in ("tilt", "drag")]
    alone, contested = judgement_of(searched(wind)), judgement_of(searched(wind, *rivals))
    assert contested.verdict == "named" and contested.confidence < alone.confidence - 0.01


@pytest.mark.parametrize("ahead,verdict", [(0.03, "set"), (0.3, "named")])
def test_strong_causes_are_distinguished_by_a_share_of_their_evidence(ahead, verdict):
    """Small errors of the model weigh more than noise does where much is at stake."""
    rival = explanation("tilt", evidence=STRONG * (1.0 - ahead))
    assert judgement_of(searched(explanation("wind"), rival)).verdict == verdict


def test_what_rivals_share_does_not_make_them_alike():
    """Two that both need the wind, which is strong, are distinguished by what they add to it."""
    best = explanation("wind", "bias", evidence=STRONG + PLAIN)
    result = searched(best, explanation("wind", "tilt", evidence=STRONG + PLAIN / 2))
    assert judgement_of(result).members
    judgement = judgement_of(replace(result, evaluated={frozenset({"wind"}): STRONG}))
    assert (judgement.effects, judgement.members) == (("wind", "bias"), ())


def test_one_certain_cause_beside_two_that_can_not_be_distinguished():
    best = explanation("wind", "bias")
    judgement = judgement_of(searched(best, explanation("wind", "tilt", evidence=STRONG - 0.1)))
    assert judgement.verdict == "named" and judgement.effects == ("wind",)
    assert set(judgement.members) == {"bias", "tilt"}


def test_confidence_of_the_members_is_shared():
    judgement = judgement_of(searched(explanation("wind"), explanation("tilt", evidence=STRONG)))
    assert judgement.each == pytest.approx({"wind": 0.5, "tilt": 0.5}, abs=0.02)


def test_noise_is_a_cause_beside_others():
    judgement = judgement_of(searched(explanation("wind")), noisy=[noise(evidence=STRONG / 2)])
    assert (judgement.verdict, judgement.effects) == ("named", ("wind", "imu_noise"))
    assert judgement_of(searched(), noisy=[noise()], explained=0.0).effects == ("imu_noise",)


@pytest.mark.parametrize("gusts,residual_r2", [(blown(), 0.6), (blown(at_edge=True), 0.0)])
def test_gusts_are_named_unless_they_repeat_or_are_at_the_edge(gusts, residual_r2):
    assert judgement_of(searched(), gusts=blown()).effects == ("gusts",)
    judgement = judgement_of(searched(), gusts=gusts, residual_r2=residual_r2, explained=0.0)
    assert judgement.verdict == "unknown" and not judgement.effects


def test_at_most_three_causes_are_named():
    many = [noise(f"noise_{k}", STRONG - k) for k in range(5)]
    named = judgement_of(searched(explanation("wind")), noisy=many).effects
    assert len(named) == 3 and named[0] == "wind"


def test_of_a_stochastic_effect_the_best_fit_counts():
    fits = [
        noise(evidence=LOG_BF_FIRST + 1, free=(1,)),
        noise(evidence=LOG_BF_FIRST + 9, free=(1, 2)),
        noise("gyro", LOG_BF_FIRST + 5),
        noise("faint", LOG_BF_FIRST - 1),
        noise("odd", math.nan),
    ]
    assert [f.free for f in select_noise_fits(fits)][:1] == [(1, 2)]
    assert [f.effect for f in select_noise_fits(fits)] == ["imu_noise", "gyro"]


def test_beside_a_strong_cause_a_weak_one_needs_more():
    # Alone either would do; by chance some effect nearly always looks a little likely.
    weak = 0.5 * (LOG_BF_FIRST + LOG_BF_ADDITIONAL)
    judgement = judgement_of(searched(explanation("mass_error", evidence=weak)), noisy=[noise()])
    assert judgement.verdict == "named" and judgement.effects == ("imu_noise",)
    judgement = judgement_of(searched(explanation("mass_error")), noisy=[noise(evidence=weak)])
    assert judgement.effects == ("mass_error",)
    enough = explanation("mass_error", evidence=LOG_BF_ADDITIONAL + 1.0)
    judgement = judgement_of(searched(enough), noisy=[noise()])
    assert set(judgement.effects) == {"mass_error", "imu_noise"}


def test_alternatives_of_a_cause_that_was_not_accepted_are_no_set():
    weak = 0.5 * (LOG_BF_FIRST + LOG_BF_ADDITIONAL)
    rival = explanation("thrust", evidence=weak - 1.0)
    judgement = judgement_of(
        searched(explanation("mass_error", evidence=weak), rival), noisy=[noise()]
    )
    assert judgement.effects == ("imu_noise",) and not judgement.members
