"""What each candidate does to the demand of the four rotors in hover: asked of the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import new_plant, pack_theta
from tombo_dynamics.errors import InputError
from tombo_dynamics.rigid_body import begin_flight, begin_tick
from tombo_dynamics.rotor_maps import RotorMaps, rotor_thrust, speed_for_thrust
from tombo_dynamics.vehicle import ARM_X, ARM_Y, GRAVITY, ROTOR_NAMES, VehicleParams

_TICK = 1e-3
_NORMALS = np.zeros(16)
_HIGH = 100.0
"""m above the floor."""
_STEPS = 6
WEAK_PROPELLER, ADDED_WEIGHT, HANGING_LOAD = "weak_propeller", "added_weight", "hanging_load"
UNBALANCE, MASS, CENTRE = "propeller_unbalance", "mass_error", "cog_offset"
OTHER = "another_cause"
"""A candidate for a change that no other candidate covers."""
_PAIR_SIZES = 16
_OTHER_SIZES = (0.03, 0.1, 0.3)
_CENTRE_ARMS = np.sinh(np.linspace(-3.5, 3.5, 29)) / np.sinh(3.5) * 0.3
"""Shares of the arm that the centre of gravity may move by, along x and along y."""

Effects = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class ChangeCandidate:
    """One thing that may have changed, of unknown size."""

    effect: str
    rotor: str
    """Which one, of ROTOR_NAMES; two of them as `a+b`; empty: it concerns no rotor."""
    sizes: Array
    """(S, k) share of thrust lost (k = 2: of two rotors), of mass added, or of the arm along x, y;
    k = 0: it has none."""
    demand: Array
    """(S, 4) change of the logarithm of thrust that the healthy curve reads in hover."""
    volume: Array
    """(S,) range of sizes of each row."""

    @property
    def label(self) -> str:
        """Effect and rotor in one name."""
        return f"{self.effect}.{self.rotor}" if self.rotor else self.effect


def effects_of(
    effect: str, rotor: str, size: float, vehicle: VehicleParams
) -> dict[str, dict[str, float]]:
    """Return the simulator's effects for a candidate of a size.

    A weight taped near a rotor changes mass and centre of gravity.
    """
    arm, mass = vehicle.arm_length, vehicle.mass
    if effect == WEAK_PROPELLER:
        return {WEAK_PROPELLER: {rotor: size}}
    if effect == MASS:
        return {MASS: {"fraction": size}}
    if effect not in (ADDED_WEIGHT, HANGING_LOAD):
        return {}
    k = ROTOR_NAMES.index(rotor)
    x, y = arm * float(ARM_X[k]), arm * float(ARM_Y[k])
    if effect == HANGING_LOAD:
        return {HANGING_LOAD: {"mass": size * mass, "x": x, "y": y}}
    share = size / (1.0 + size)
    return {MASS: {"fraction": size}, CENTRE: {"x": share * x, "y": share * y}}


def candidates(vehicle: VehicleParams, maps: RotorMaps, sizes: Array) -> list[ChangeCandidate]:
    """Return all candidates with their demand in hover, from the simulated vehicle.

    Args:
        vehicle: its geometry counts; shares of thrust and mass are the same for any size.
        maps: its rotors.
        sizes: (S,) above 0, to be tried.
    """
    healthy = hover_thrust(vehicle, maps, {})

    def of(effect: str, rotor: str, sizes: Array) -> ChangeCandidate:
        return _candidate(effect, rotor, sizes, vehicle, maps, healthy)

    weak = {r: of(WEAK_PROPELLER, r, sizes) for r in ROTOR_NAMES}
    few = sizes[np.linspace(0, len(sizes) - 1, _PAIR_SIZES).round().astype(int)]
    some = {r: of(WEAK_PROPELLER, r, few) for r in ROTOR_NAMES}
    both = np.concatenate([-sizes[::-1], sizes])
    still = np.zeros((1, 4))
    wide = np.array(_OTHER_SIZES)
    return [
        *weak.values(),
        *(_pair(some[a], some[b]) for a, b in combinations(ROTOR_NAMES, 2)),
        *(of(e, r, sizes) for e in (ADDED_WEIGHT, HANGING_LOAD) for r in ROTOR_NAMES),
        of(MASS, "", both[both > -0.4]),
        _centre(vehicle, maps, healthy),
        *(ChangeCandidate(UNBALANCE, r, np.zeros((1, 0)), still, np.ones(1)) for r in ROTOR_NAMES),
        ChangeCandidate(OTHER, "", wide[:, None], np.zeros((3, 4)), np.ones(3)),
    ]


def _candidate(
    effect: str, rotor: str, sizes: Array, vehicle: VehicleParams, maps: RotorMaps, healthy: Array
) -> ChangeCandidate:
    possible, rows = [], []
    for size in sizes:
        try:
            now = hover_thrust(vehicle, maps, effects_of(effect, rotor, size, vehicle))
        except InputError:
            continue  # so large that it would not hover
        possible.append(size)
        rows.append(np.log(now / healthy))
    volume = np.abs(np.gradient(possible)) if len(possible) > 1 else np.ones(len(possible))
    return ChangeCandidate(effect, rotor, np.array(possible)[:, None], np.array(rows), volume)


def _pair(one: ChangeCandidate, other: ChangeCandidate) -> ChangeCandidate:
    """Return two weak propellers of any sizes: each asks for more of its own rotor alone."""
    i, j = np.indices((len(one.sizes), len(other.sizes))).reshape(2, -1)
    return ChangeCandidate(
        one.effect, f"{one.rotor}+{other.rotor}",
        np.column_stack([one.sizes[i], other.sizes[j]]),
        one.demand[i] + other.demand[j], one.volume[i] * other.volume[j],
    )  # fmt: skip


def _centre(vehicle: VehicleParams, maps: RotorMaps, healthy: Array) -> ChangeCandidate:
    """Return the centre of gravity moved along x and y, to first order."""
    step, arm = 0.02, vehicle.arm_length
    moved = [hover_thrust(vehicle, maps, {CENTRE: {axis: step * arm}}) for axis in "xy"]
    slopes = np.log(np.array(moved) / healthy) / step
    sizes = np.stack(np.meshgrid(_CENTRE_ARMS, _CENTRE_ARMS, indexing="ij"), -1).reshape(-1, 2)
    width = np.gradient(_CENTRE_ARMS)
    return ChangeCandidate(CENTRE, "", sizes, sizes @ slopes, np.outer(width, width).ravel())


def hover_thrust(vehicle: VehicleParams, maps: RotorMaps, effects: Effects) -> Array:
    """Return what healthy rotors would give [N] at the speeds that hover asks for (4,).

    Newton's method on force and moment of the simulator's own first slope, level and at rest.

    Raises:
        InputError: the vehicle can't hover so within its range of speeds.
    """
    theta = pack_theta(effects)
    plant = new_plant(vehicle)
    plant.state.position[2] = _HIGH
    begin_flight(plant, _NORMALS, theta, _TICK)
    mass = float(plant.mass)
    scale = np.array([mass * GRAVITY, *[0.1 * mass * GRAVITY * vehicle.arm_length] * 3])

    def imbalance(thrust: Array) -> Array:
        speed = np.array([speed_for_thrust(maps, t) for t in thrust])
        plant.rotor_speed = speed
        plant.rotor_command = speed
        plant.past_commands[:] = speed
        begin_tick(plant, maps, _NORMALS, theta)
        up = plant.force[2] - mass * GRAVITY
        return np.asarray(np.array([up, *plant.moment]) / scale)

    thrust = np.full(4, mass * GRAVITY / 4.0)
    step = 1e-3 * mass * GRAVITY
    for _ in range(_STEPS):
        here = imbalance(thrust)
        slope = np.column_stack([(imbalance(thrust + d) - here) / step for d in step * np.eye(4)])
        thrust = thrust - np.linalg.solve(slope, here)
        lowest, highest = 1.05 * maps.thrust_lowest, maps.thrust_highest - 2.0 * step
        if not ((thrust > lowest) & (thrust < highest)).all():
            raise InputError(f"the vehicle can't hover with {dict(effects)}")
    speed = np.array([speed_for_thrust(maps, t) for t in thrust])
    return np.array([rotor_thrust(maps, s) for s in speed])
