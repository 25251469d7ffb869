"""The frame against the obstacle: a push and a rub, and never more energy than before."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_vehicle import Vehicle, random_attitude
from scipy.spatial.transform import Rotation

STIFF = {"contact_force": {"stiffness": 6000.0, "damping": 25.0}}
POLE = (1.0, 0.0, 0.2, 5.0)
ARM_TO_POLE = Rotation.from_euler("z", math.pi / 4)
"""Heading at which the front-right arm points along +x, to the pole."""
TOUCH = 1.0 - 0.2 - 0.24 - 0.02
"""x of the centre when that arm's end touches the pole: radius, arm, half the arm's thickness."""


def against(no_air, x=TOUCH, velocity=(1.0, 0.0, 0.0), effects=STIFF, **more):
    given = {"position": (x, 0.0, 2.0), "attitude": ARM_TO_POLE.as_quat()} | more
    return Vehicle(effects, maps=no_air, velocity=velocity, obstacle=POLE, **given)


def hit(v, seconds=0.15):
    """Fly through a contact; return the forces on the frame, in map, a row a tick."""
    return v.fly(seconds, watch=lambda v: v.plant.contact.force * v.plant.contact.touching)


def test_the_bounce_lasts_half_a_period_of_the_spring(no_air):
    v = against(no_air, effects={"contact_force": {"stiffness": 6000.0, "damping": 0.0}})
    forces = hit(v)
    ticks = np.count_nonzero(forces[:, 0])
    assert ticks * 1e-3 == pytest.approx(math.pi * math.sqrt(v.mass / 6000.0), abs=2e-3)
    peak = math.sqrt(6000.0 * v.mass) * 1.0
    assert -forces[:, 0].min() == pytest.approx(peak, rel=0.01)


@pytest.mark.parametrize("aside", [-0.06, 0.0, 0.05])
@pytest.mark.parametrize("sideways", [-0.8, 0.0, 0.5])
def test_impulse_of_the_force_is_the_change_of_momentum(no_air, aside, sideways):
    v = against(no_air, velocity=(1.2, sideways, 0.0))
    v.position[1] = aside
    velocity = v.velocity.copy()
    impulse = 1e-3 * hit(v).sum(axis=0)
    gained = v.mass * (v.velocity - velocity)
    assert np.linalg.norm(impulse) > 0.5
    assert gained[:2] == pytest.approx(impulse[:2], abs=0.03 * np.linalg.norm(impulse))


def test_moment_is_arm_times_force(no_air):
    v = against(no_air, velocity=(1.2, 0.4, 0.0), x=TOUCH + 0.02)
    v.position[1] = 0.05
    v.begin()
    force, point = v.plant.contact.force, v.plant.contact.point
    expected = np.cross(point - v.position, force)
    assert v.rotation.apply(v.plant.force) == pytest.approx(force)
    assert v.rotation.apply(v.plant.moment) == pytest.approx(expected, abs=1e-12)
    assert abs(expected[2]) > 0.1


@settings(max_examples=60)
@given(st.integers(0, 100_000))
def test_contact_pushes_away_and_rubs_against_the_motion(seed):
    """Wherever the frame is touched and however it moves: it never pulls, never drives."""
    rng = np.random.default_rng(seed)
    heading = math.pi / 4 + rng.uniform(-0.5, 0.5)  # one arm, and it alone, points at the pole
    lean = Rotation.from_euler("ZYX", [heading, *rng.normal(0.0, 0.1, 2)])
    v = Vehicle(
        STIFF, position=(rng.uniform(0.54, 0.62), rng.uniform(-0.1, 0.1), 2.0), obstacle=POLE,
        velocity=rng.normal(0.0, 1.0, 3), attitude=lean.as_quat(), rates=rng.normal(0, 2, 3),
    )  # fmt: skip
    v.begin()
    if not v.plant.contact.touching:
        return
    force, point = v.plant.contact.force, v.plant.contact.point
    outward = np.append(point[:2] - POLE[:2], 0.0)
    outward /= np.linalg.norm(outward)
    normal = force @ outward
    rub = force - normal * outward
    moving = v.velocity + np.cross(v.rotation.apply(v.rates), point - v.position)
    sliding = moving - (moving @ outward) * outward
    assert normal >= 0.0
    assert np.linalg.norm(rub) <= v.params.friction * normal * (1.0 + 1e-9)
    assert rub @ sliding <= 0.0
    assert np.linalg.norm(np.cross(rub, sliding)) < 1e-9 * (1.0 + normal)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 100_000))
def test_a_collision_never_gives_energy(seed):
    """Thrown at the pole from the side, in any attitude, rotors at rest."""
    rng = np.random.default_rng(seed)
    v = Vehicle(
        STIFF, position=(0.0, rng.uniform(-0.3, 0.3), 3.0), obstacle=POLE,
        velocity=(rng.uniform(1.0, 3.0), *rng.normal(0.0, 0.3, 2)),
        attitude=random_attitude(rng), rates=rng.normal(0.0, 2.0, 3),
    )  # fmt: skip
    before = v.energy()
    seen = v.fly(0.6, watch=Vehicle.energy)
    # while an arm swings past, its nearest point jumps: a spring's worth of a few millimetres
    assert seen.max() <= before + 0.02 * before
    assert seen[-1] <= before + 1e-6


def test_no_contact_out_of_reach_above_the_top_or_without_an_obstacle(no_air):
    def touches(v):
        v.begin()
        assert v.plant.contact.touching == (1.0 if np.abs(v.wrench).max() > 0.0 else 0.0)
        return bool(v.plant.contact.touching)

    assert touches(against(no_air, x=TOUCH + 0.001))
    assert not touches(against(no_air, x=TOUCH - 0.001))
    assert not touches(against(no_air, x=TOUCH + 0.01, position=(TOUCH + 0.01, 0.0, 5.1)))
    nothing = against(no_air, x=TOUCH + 0.01)
    nothing.plant.obstacle.radius = 0.0
    assert not touches(nothing)


def test_the_arms_start_at_the_centre_not_at_the_centre_of_gravity(no_air):
    """The state is the centre of gravity's; 2 cm ahead of the centre it gets 2 cm closer."""
    off = 0.02 * math.sqrt(0.5)
    along_the_arm = STIFF | {"cog_offset": {"x": off, "y": -off}}
    for closer, touches in ((0.019, False), (0.021, True)):
        v = against(no_air, x=TOUCH + closer, effects=along_the_arm)
        v.begin()
        assert bool(v.plant.contact.touching) == touches
