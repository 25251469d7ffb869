"""A blade meets the obstacle: momentum is booked on both sides, thrust goes and comes back."""

import math

import numpy as np
import pytest
from one_vehicle import Vehicle, hover_speed
from scipy.spatial.transform import Rotation

from tombo_dynamics.propeller import configuration, configurations
from tombo_dynamics.propeller.mounted_propeller import propeller_performance
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN, VehicleParams

TOMBO = {"peak_force": 145.5, "recovery_time": 0.42, "slant": 0.4, "duration": 0.014}
RADIUS = VehicleParams().rotor_radius
ARM = VehicleParams().arm_length
NODUS = VehicleParams().nodus_radius
POLE = 0.25
HOVER = hover_speed()


def hub(rotor):
    return np.array([ARM * ARM_X[rotor], ARM * ARM_Y[rotor], VehicleParams().rotor_height])


def struck(rotor=2, bearing=0.0, depth=0.001, wear=0.0, heading=0.0, pole=POLE, **more):
    """Return a vehicle whose `rotor` cuts `depth` into a pole at `bearing` from it.

    `bearing` is in base_link, 0 ahead; 0.785 on the front-left is straight outwards.
    """
    strike = TOMBO | {key: more.pop(key) for key in tuple(more) if key in TOMBO}
    effects = {"blade_strike": strike, "propeller_wear": {"collisions": wear}}
    effects |= more.pop("effects", {})
    gap = RADIUS + pole - depth
    ahead = [math.cos(bearing), math.sin(bearing), 0.0]
    turn = Rotation.from_euler("z", heading)
    place = turn.apply(hub(rotor) + gap * np.array(ahead))
    where = {"position": (0.0, 0.0, 2.0), "speed": HOVER} | more
    axis = np.array(where["position"])[:2] + place[:2]
    return Vehicle(effects, obstacle=(*axis, pole, 100.0), attitude=turn.as_quat(), **where)


def bench(v, seconds):
    """Let the rotors run on a test bench: the airframe cannot move. Return thrusts over time."""
    body = v.body.copy()
    thrusts = []
    for _ in range(round(seconds * 1e3)):
        v.body = body
        v.begin()
        thrusts.append(v.plant.rotor_thrust.copy())
        v.finish()
    return np.array(thrusts)


def outward(v, rotor):
    """Return the unit vector from a hub to the obstacle, in base_link."""
    way = (
        np.array([v.plant.obstacle.x, v.plant.obstacle.y])
        - (v.position + v.rotation.apply(hub(rotor)))[:2]
    )
    way = np.append(way / np.linalg.norm(way), 0.0)
    return v.rotation.inv().apply(way)


# --- one tick's bookkeeping -----------------------------------------------------------------

SPOTS = [(0, -0.8), (1, 3.0), (2, 0.0), (3, -2.4)]
"""Rotor, and bearing of the obstacle from its hub."""


@pytest.mark.parametrize("rotor, bearing", SPOTS)
@pytest.mark.parametrize("heading", [0.0, 1.9])
def test_the_push_leans_from_away_towards_against_the_blade(rotor, bearing, heading):
    v = struck(rotor, bearing, heading=heading)
    v.begin()
    force = v.plant.strike_force
    out = outward(v, rotor)
    blade_moves = SPIN[rotor] * np.cross([0.0, 0.0, 1.0], out)
    assert force @ out == pytest.approx(-145.5 * math.cos(0.4))
    assert force @ blade_moves == pytest.approx(-145.5 * math.sin(0.4))
    assert force[2] == 0.0


@pytest.mark.parametrize("rotor, bearing", SPOTS)
def test_rotor_loses_the_angular_momentum_of_the_tangential_push(rotor, bearing):
    v = struck(rotor, bearing)
    v.begin()
    tangential = np.linalg.norm(np.cross(v.plant.strike_force, outward(v, rotor)))
    lost = v.params.rotor_inertia * (HOVER - v.plant.rotor_speed[rotor])
    lever = lost / (tangential * 1e-3)
    assert NODUS <= lever <= RADIUS * (1.0 + 1e-12)  # but for rounding
    assert lever == pytest.approx(RADIUS, rel=1e-6)  # it is struck at the tip
    energy = 0.5 * v.params.rotor_inertia * (HOVER**2 - v.plant.rotor_speed[rotor] ** 2)
    assert v.plant.strike_energy[rotor] == pytest.approx(energy)
    others = np.delete(np.arange(4), rotor)
    assert (v.plant.rotor_speed[others] == HOVER).all()
    assert not v.plant.strike_energy[others].any()


@pytest.mark.parametrize("rotor, bearing", SPOTS)
@pytest.mark.parametrize("offset", [{}, {"cog_offset": {"x": 0.03, "y": -0.02}}])
def test_vehicle_and_rotor_together_get_the_torque_of_the_contact_point(rotor, bearing, offset):
    """About the centre of gravity: moment on the airframe plus change of the rotor's momentum."""
    v = struck(rotor, bearing, effects=offset)
    shift = [offset["cog_offset"]["x"], offset["cog_offset"]["y"], 0.0] if offset else np.zeros(3)
    v.position[:] += shift  # the disc stays where it was, the state is the centre of gravity's
    v.begin()
    assert v.plant.contact.touching and v.plant.contact.rotor == rotor
    point = v.plant.contact.point - v.position
    torque = np.cross(point, v.plant.strike_force)
    on_rotor = SPIN[rotor] * v.params.rotor_inertia * (v.plant.rotor_speed[rotor] - HOVER) / 1e-3
    assert v.plant.strike_moment[2] + on_rotor == pytest.approx(torque[2])
    assert v.plant.strike_moment[:2] == pytest.approx(torque[:2])
    rim = point + shift - hub(rotor)
    assert np.linalg.norm(rim) == pytest.approx(RADIUS)


# --- the course of a strike -----------------------------------------------------------------


def test_the_push_fades_while_the_blade_folds():
    v = struck()
    body = v.body.copy()
    pushes, folds = [], []
    for _ in range(20):
        v.body = body
        v.begin()
        pushes.append(np.linalg.norm(v.plant.strike_force))
        folds.append(v.plant.fold[2])
        v.finish()
    assert pushes[0] == pytest.approx(145.5)
    assert (np.diff(pushes[:15]) < 0.0).all()
    assert not any(pushes[15:])
    assert folds[13] == pytest.approx(1.0)
    assert max(folds) <= 1.0


@pytest.mark.parametrize(("conf", "speed"), [(5, HOVER), (9, 2000 * math.pi / 30), (13, HOVER)])
def test_thrust_collapses_and_returns_in_the_measured_time(conf, speed):
    """A bench test at constant command, as behind Table III; drive and folding add their own."""
    figures = propeller_performance(configuration(conf), configurations())
    v = struck(
        speed=speed, peak_force=figures["collision_force_N"],
        recovery_time=figures["recovery_s"],
    )  # fmt: skip
    struck_thrust = bench(v, 0.010)
    v.plant.obstacle.radius = 0.0  # the pole is taken away
    thrust = np.vstack([struck_thrust, bench(v, 1.5)])
    before = thrust[0, 0]
    assert thrust[:, [0, 1, 3]] == pytest.approx(before)
    share = thrust[:, 2] / before
    assert share[:20].min() < 0.05
    lowest = int(np.argmin(share))
    back = (lowest + np.argmax(share[lowest:] > 0.9)) * 1e-3
    lag = v.params.motor_time_constant + TOMBO["duration"]
    assert figures["recovery_s"] - 0.01 <= back <= figures["recovery_s"] + lag
    assert share[-1] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("conf", "speed", "bearing"), [(5, 400.0, 0.8), (9, HOVER, -0.5), (13, 600.0, 0.0)]
)
def test_the_airframe_gets_less_energy_than_the_rotor_loses(conf, speed, bearing):
    """At flight speeds; the push does not ask the rotor what it has, so idling ones give more."""
    figures = propeller_performance(configuration(conf), configurations())
    v = struck(bearing=bearing, speed=speed, peak_force=figures["collision_force_N"])
    free = struck(speed=speed)
    free.plant.obstacle.radius = 0.0
    lost = v.fly(0.016, watch=lambda v: v.plant.strike_energy.sum()).sum()
    free.fly(0.016)
    gained = v.energy() - free.energy()
    assert lost > 1.0
    assert gained < lost


# --- breaking and wearing -------------------------------------------------------------------


def test_a_rigid_blade_breaks_and_stays_broken():
    v = struck(peak_force=269.3, recovery_time=0.0, wear=0.01)
    bench(v, 0.02)
    assert v.plant.damage[2] >= 1.0
    v.plant.obstacle.radius = 0.0
    thrust = bench(v, 3.0)
    assert not thrust[:, 2].any()
    assert (v.plant.fold == [0.0, 0.0, 1.0, 0.0]).all()
    assert v.plant.rotor_speed[2] < 1.0
    assert thrust[-1, [0, 1, 3]].min() > 1.0


def strike_and_recover(v):
    pole = v.plant.obstacle.radius
    bench(v, 0.03)
    v.plant.obstacle.radius = 0.0
    thrust = bench(v, 1.5)
    v.plant.obstacle.radius = pole
    return thrust[-1, 2]


def test_the_third_full_strike_tears_a_blade_off():
    v = struck(wear=3.0)
    whole = strike_and_recover(v)
    assert whole > 3.0
    assert 0.3 < v.plant.damage[2] < 0.5
    assert strike_and_recover(v) == pytest.approx(whole, rel=0.01)
    assert v.plant.damage[2] < 1.0
    assert strike_and_recover(v) == 0.0
    assert not v.plant.damage[[0, 1, 3]].any()


# --- where nothing happens ------------------------------------------------------------------


def untouched(v):
    v.begin()
    return not (
        v.plant.strike_force.any()
        or v.plant.fold.any()
        or v.plant.contact.touching
        or (v.plant.rotor_speed != HOVER).any()
    )


@pytest.mark.parametrize("rotor, bearing", SPOTS)
def test_the_disc_ends_at_the_tip(rotor, bearing):
    assert untouched(struck(rotor, bearing, depth=-1e-6))
    assert not untouched(struck(rotor, bearing, depth=1e-6))


def test_a_disc_above_the_top_passes():
    v = struck()
    v.plant.obstacle.top = 2.03 - 1e-6
    assert untouched(v)
    v.plant.obstacle.top = 2.03 + 1e-6
    assert not untouched(v)
