"""Hidden effects are found, told as a set where nothing tells them, and not made up."""

import numpy as np
import pytest
import stands

from tombo_diagnosis.engine.verdict import separating_experiment
from tombo_diagnosis.stand.analyse import LOG_BF_CURVES, analyse
from tombo_diagnosis.stand.causes import estimate_cause, held_out, scores
from tombo_diagnosis.stand.problem import StandProblem
from tombo_diagnosis.stand.summary_text import repeats
from tombo_dynamics.propeller.effects import STAND_EFFECTS, Draws

pytestmark = pytest.mark.slow


def causes(result):
    return [estimate_cause(e, result) for e in result.judgement.effects]


SETUP = stands.setup()
HAS_MEAN = [n for n, e in STAND_EFFECTS.items() if not e.stochastic and e.suits("tombo")]


@pytest.mark.parametrize("seed", range(4))
def test_a_healthy_stand_has_no_cause(seed):
    result = analyse(stands.read(SETUP, {}, seed=seed))
    assert result.judgement.verdict == "none"


@pytest.mark.parametrize("name", HAS_MEAN)
def test_every_effect_is_named_on_a_calibrated_stand(name):
    unknowns = StandProblem(stands.read(SETUP, {})).unknowns
    own = [p for p in unknowns.parameters if p.effect == name]
    theta = tuple(p.null + (p.scale if p.null + p.scale <= p.high else -p.scale) for p in own)
    if name in ("torsion_constant", "load_sharing"):
        theta = (0.6,)
    result = analyse(stands.read(SETUP, {name: theta}, seed=3))
    assert result.judgement.verdict in ("named", "set")
    if name == "in_plane_term":  # at these speeds it saturates the twist as stiffening does
        assert set(result.judgement.members) == {"centrifugal_stiffening", "in_plane_term"}
    else:
        assert result.judgement.effects[:1] == (name,)
    [fitted] = next(c for c in causes(result) if c.effect == name).theta
    assert fitted.value == pytest.approx(theta[0], abs=0.25 * own[0].scale)
    assert fitted.low <= fitted.value <= fitted.high


def test_speed_noise_and_scatter_are_found_by_their_spread():
    rng = np.random.default_rng(5)
    s = stands.setup(confs=(9, 9, 9, 13, 13), runs=2)
    wide = Draws(
        np.tile([[1.5, -1.0], [-1.2, 1.4], [0.8, 1.0], [-1.6, -1.2], [1.1, 0.6]], 1),
        np.zeros((10, 2)),
        rng.standard_normal(s.speed.size),
    )
    for name, theta in (("speed_noise", (0.02,)), ("fabrication_scatter", (0.08, 0.08))):
        result = analyse(stands.read(s, {name: theta}, draws=wide, seed=1))
        assert result.judgement.effects == (name,)


def test_thrust_alone_gives_a_set_and_says_what_separates():
    s = stands.setup(confs=(13,), runs=3, loads=False)
    points = stands.read(s, {"thrust_gain": (0.12,)}, channels=1, seed=2)
    result = analyse(points)
    assert result.judgement.verdict == "set"
    expected = {"thrust_gain", "thrust_coefficient", "air_density", "rpm_scale"}
    assert expected <= set(result.judgement.members)
    experiment = separating_experiment(result.judgement.members, STAND_EFFECTS)
    assert experiment is not None
    assert "weight" in experiment.text


def test_known_weights_end_that_confusion():
    points = stands.read(stands.setup(confs=(13,), runs=3), {"thrust_gain": (0.12,)}, 1, 2)
    result = analyse(points)
    assert result.judgement.verdict == "named"
    assert result.judgement.effects == ("thrust_gain",)


def test_torque_parts_a_coefficient_from_the_density():
    s = stands.setup(loads=False)
    result = analyse(stands.read(s, {"air_density": (0.12,)}, channels=2, seed=2))
    named = {*result.judgement.effects, *result.judgement.members}
    assert "thrust_coefficient" not in named
    assert "air_density" in named


def more_thrust(share):
    """Readings with thrust by a share more: a function of the speed over the highest."""

    def change(y, s):
        out = y.copy()
        out[:, 0] *= 1.0 + share(s.speed / s.speed.max()) * (s.speed > 0.0)
        return out

    return change


def test_a_shape_that_nobody_named_gets_no_name():
    wavy = more_thrust(lambda x: 0.06 * np.sin(14.0 * x))
    result = analyse(stands.read(SETUP, {}, change=wavy))
    assert result.judgement.verdict == "unknown"
    assert result.remainder.curves.channel == "thrust"
    assert result.remainder.curves.size > 0.01


def again(share):
    """Two runs of one propeller, the second one's thrust by `share` more."""

    def more(y, s):
        out = y.copy()
        out[s.run == 1, 0] *= 1.0 + share
        return out

    return lambda channels, seed: stands.read(
        stands.setup(confs=(13,), runs=2, loads=False), {}, channels, seed, change=more
    )


@pytest.mark.parametrize("share", [0.02, 0.03, 0.05, 0.10])
@pytest.mark.parametrize("channels", [1, 2])
def test_runs_that_differ_by_a_share_are_no_speed_noise(share, channels):
    result = analyse(again(share)(channels, 1))
    judgement = result.judgement
    assert "speed_noise" not in {*judgement.effects, *judgement.members}
    if share >= 0.05:
        assert judgement.effects == ("run_scatter",)
        thrust, *torque = causes(result)[0].theta
        assert thrust.value == pytest.approx(share / 2.0, rel=0.6)
        assert len(torque) == channels - 1 and all(t.value < 0.005 for t in torque)
    [told, *_] = repeats(result.problem)
    assert "differ" in told
    percent = float(told.split("differ by ")[1].split(" %")[0])
    assert percent == pytest.approx(100.0 * share, abs=0.4)


def test_what_the_model_has_and_these_runs_have_not_is_found_with_both_values():
    base = {"thrust_tare": (0.147,)}
    [cause] = causes(analyse(stands.read(SETUP, {}, seed=7), base=base))
    (tare,) = cause.theta
    assert (cause.effect, tare.nominal) == ("thrust_tare", 0.147) and tare.low < 0.0 < tare.high


def test_two_causes_are_both_found():
    theta = {"thrust_tare": (0.25,), "torque_gain": (0.12,)}
    result = analyse(stands.read(SETUP, theta, seed=4))
    assert set(result.judgement.effects) == set(theta)


def test_held_out_points_confirm_a_cause_and_not_a_wrong_one():
    result = analyse(stands.read(SETUP, {"thrust_coefficient": (0.12,)}, seed=6))
    gains, shares = held_out(result)
    thrust = next(g for g in gains if g.channel == "thrust")
    assert thrust.reduction > 0.7 and thrust.low > 0.0
    assert shares["thrust_coefficient"] > 0.9 > 0.2 > shares["torque_tare"]


def test_an_effect_that_no_channel_shows_is_not_excited():
    s = stands.setup(loads=False)
    result = analyse(stands.read(s, {}, channels=1))
    blind = {c.effect for c in scores(result, {}) if not c.excited}
    assert {"torque_gain", "torque_tare", "angle_offset"} <= blind
    assert "thrust_gain" not in blind


def test_a_name_is_withheld_where_free_curves_find_more_beside_it():
    """A gain explains most, but a resonance is left: the gate has to see it."""
    resonant = more_thrust(lambda x: -0.04 * np.exp(-(((x - 0.6) / 0.08) ** 2)))
    clean = analyse(stands.read(SETUP, {"thrust_gain": (0.1,)}, seed=9))
    assert clean.judgement.verdict == "named"
    assert clean.remainder.curves.evidence < LOG_BF_CURVES
    result = analyse(stands.read(SETUP, {"thrust_gain": (0.1,)}, seed=9, change=resonant))
    remainder, best = result.remainder, result.search.best
    assert best.effects == ("thrust_gain",)
    # Only what is left can tell.
    assert best.evidence > remainder.curves_without_causes.evidence + 10.0
    assert remainder.curves.evidence > LOG_BF_CURVES
    assert result.judgement.verdict == "partly_explained"
