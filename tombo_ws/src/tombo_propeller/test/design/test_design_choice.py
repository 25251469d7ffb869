"""The recommendation, and the reasons for none."""

import dataclasses

import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import configuration, nodus_moduli
from tombo_propeller.design.candidates import PROPERTIES
from tombo_propeller.design.design import choose
from tombo_propeller.design.request import NAMES, QUANTITIES, DesignLimit, DesignRequest, arm_of
from tombo_propeller.design.summary_text import relief_lines

BLADE = configuration(13).blade


def limits(**values) -> tuple[DesignLimit, ...]:
    return tuple(DesignLimit(q, values[q.name]) for q in QUANTITIES if q.name in values)


def best(design) -> int:
    return design.choice.order[0]


def test_measured_propellers_go_first(made):
    design = made(mass_kg=1.3, min_thrust_margin=1.7, max_collision_force_N=150.0)
    names = {design.evaluated.configurations[i].number for i in design.choice.order}
    assert names == {8, 10, 11, 13}  # 9 and 12 strike harder, 5 to 7 can't lift
    assert (
        design.evaluated.configurations[best(design)].number == 11
    )  # most to spare in the worse one


@pytest.mark.slow
def test_a_heavier_vehicle_gets_a_stiffer_nodus_or_none(made):
    stiffness = []
    for mass in (0.35, 0.8, 1.3, 1.55):
        design = made(mass_kg=mass, min_thrust_margin=1.5, max_collision_force_N=130.0)
        able = [
            nodus_moduli(design.evaluated.configurations[i]).G_N_MPa
            for i in np.flatnonzero(design.choice.feasible & (design.evaluated.tier == 0))
        ]
        stiffness.append(min(able))
    assert stiffness == sorted(stiffness)
    assert stiffness[-1] > 3.0 * stiffness[0]
    assert not made(mass_kg=2.5, min_thrust_margin=1.5, max_collision_force_N=130.0).feasible


def test_what_was_not_measured_counts_at_the_worse_end(made):
    design = made(mass_kg=1.3, min_thrust_margin=1.5)
    column = NAMES.index("collision_force_N")
    conf_3 = next(i for i, c in enumerate(design.evaluated.configurations) if c.number == 3)
    conf_13 = next(i for i, c in enumerate(design.evaluated.configurations) if c.number == 13)
    assert design.evaluated.counted[conf_13, column] == 145.5
    assert design.evaluated.labels[conf_13, column] == "measured"
    within = np.flatnonzero(design.evaluated.tier == 1)
    assert within.size
    assert (
        design.evaluated.counted[within, column] > design.evaluated.value[within, column] + 40.0
    ).all()
    assert (
        design.evaluated.labels[conf_3, column] == "extrapolated"
    )  # more fibre than any measured
    assert np.isnan(design.evaluated.counted[conf_3, column])


@pytest.mark.slow
def test_outside_of_the_tests_only_what_is_asked_for_counts(made):
    closed = made(mass_kg=1.3, min_thrust_margin=2.3, max_collision_force_N=185.0)
    opened = made(
        mass_kg=1.3, min_thrust_margin=2.3, max_collision_force_N=185.0, extrapolate=True
    )
    assert not closed.feasible
    assert any("--extrapolate" in line for line in relief_lines(closed))
    assert opened.feasible
    assert opened.evaluated.outside(best(opened))


def test_the_least_extrapolated_one_goes_first(made):
    design = made(mass_kg=1.4, min_thrust_margin=2.0)
    assert design.evaluated.tier[best(design)] == 2
    distances = design.evaluated.distance[design.choice.feasible]
    assert design.evaluated.distance[best(design)] == distances.min()


@pytest.mark.parametrize(
    "asked",
    [
        {"thrust_margin": 2.5, "collision_force_N": 150.0},
        {"thrust_margin": 1.7, "collision_force_N": 70.0},
        {"thrust_margin": 1.7, "collision_force_N": 150.0, "noise_dB": 48.0},
        {"thrust_margin": 1.7, "recovery_s": 0.25, "lift_over_drag": 1.7},
    ],
)
def test_a_limit_that_gives_as_much_as_is_said_is_kept_and_no_less(made, asked):
    evaluated = made(mass_kg=1.3, max_collision_force_N=150.0, min_thrust_margin=1.7).evaluated
    asked = limits(**asked)
    choice = choose(evaluated, asked, 0.08)
    assert not choice.order
    assert any(value is not None for value in choice.relief)
    for k, value in enumerate(choice.relief):
        if value is None:
            continue
        sign = -1.0 if asked[k].quantity.more_is_better else 1.0
        for change, feasible in ((1e-9, True), (-1e-3, False)):
            given = [*asked]
            given[k] = dataclasses.replace(asked[k], value=value + sign * change)
            assert bool(choose(evaluated, given, 0.08).order) == feasible


@pytest.mark.slow
def test_a_users_material_is_considered(made, stiff_library):
    plain, own = (
        made(library=folder, mass_kg=2.2, min_thrust_margin=2.5)
        for folder in (None, stiff_library)
    )
    assert own.choice.relief[0] > plain.choice.relief[0]
    between = 0.5 * (own.choice.relief[0] + plain.choice.relief[0])
    assert not made(mass_kg=2.2, min_thrust_margin=between).feasible
    design = made(library=stiff_library, mass_kg=2.2, min_thrust_margin=between)
    nodi = [design.evaluated.configurations[i].nodus for i in design.choice.order]
    assert {nodus.matrix.name for nodus in nodi} == {"Stiff50"}


def test_a_users_measured_propeller_is_recommended_for_what_it_measured(made, measured_library):
    design = made(
        library=measured_library, mass_kg=1.3, min_thrust_margin=2.2, max_collision_force_N=130.0
    )
    assert design.evaluated.configurations[best(design)].number == 20
    assert design.evaluated.readings["recovery_s"].count == 10
    assert design.evaluated.tested[1, list(PROPERTIES).index("G_N_MPa")] > 0.4


def test_a_prediction_must_gain_more_than_the_model_is_wrong_by(made):
    design = made(mass_kg=1.3, min_thrust_margin=1.5)
    worst = design.choice.slack.min(axis=1)
    measured = worst[design.evaluated.tier == 0].max()
    rival = int(np.flatnonzero((design.evaluated.tier == 2) & (worst > measured + 0.02))[0])
    tier = design.evaluated.tier.copy()
    tier[tier == 1] = 2
    tier[rival] = 1
    trusted = dataclasses.replace(design.evaluated, tier=tier)
    more = float(worst[rival] - measured)
    assert choose(trusted, design.choice.limits, 0.9 * more).order[0] == rival
    assert choose(trusted, design.choice.limits, 1.1 * more).order[0] == best(design)
    assert design.evaluated.tier[best(design)] == 0  # an extrapolation never ranks higher


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"mass_kg": float("nan")}, "--mass"),
        ({"mass_kg": 0.0}, "--mass"),
        ({"mass_kg": 1300.0}, "--mass"),
        ({"min_thrust_margin": 1.0}, "--min-thrust-margin"),
        ({"max_collision_force_N": -5.0}, "--max-collision-force"),
        ({"max_recovery_s": 400.0}, "--max-recovery"),
        ({"max_noise_dB": float("inf")}, "--max-noise"),
        ({"min_lift_over_drag": 0.0}, "--min-lift-over-drag"),
        ({"confidence": 1.0}, "--confidence"),
        ({"law": "published"}, "--law"),
        ({"law": "repared"}, "did you mean 'repaired'"),
    ],
)
def test_bad_requests_are_refused(values, words):
    with pytest.raises(InputError, match=words):
        DesignRequest(**{"mass_kg": 1.3, **values})


@pytest.mark.parametrize("frame", ["", "s600", "0.24", "157", "2000", "nan", "inf", "-240"])
def test_bad_frames_are_refused(frame):
    with pytest.raises(InputError, match=r"--frame .*accepted: s500"):
        arm_of(frame, BLADE)


def test_arm_length_of_a_named_frame_or_a_diagonal():
    assert arm_of("S500", BLADE) == 0.24
    assert arm_of("225", BLADE) == pytest.approx(0.225)
