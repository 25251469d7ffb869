"""Which propeller is mounted: the parameters of whoever needs its thrust map, or its impact.

A Tombo propeller is a configuration of a library, whose model gives thrust and torque. A plain one
is any other: two coefficients, or a measured curve.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown, shown_names, unknown_name
from tombo_dynamics.params import check_number, param, structure
from tombo_dynamics.propeller.library import Library, read_library
from tombo_dynamics.propeller.records import Configuration
from tombo_dynamics.propeller.thrust_map import ThrustMap, thrust_map
from tombo_dynamics.rotor_maps import RotorMaps, rotor_maps
from tombo_dynamics.vehicle import VehicleParams

Curve = tuple[tuple[float, float, float], ...]
"""Rows of speed [rad/s], thrust [N], drag torque [N m]; all of them rise."""
_COLUMNS = (
    ("speed", "rad/s", (1.0, 10_000.0)),
    ("thrust", "N", (1e-6, 1000.0)),
    ("torque", "N m", (1e-9, 100.0)),
)
_FEWEST, _MOST = 2, 10_000


def read_curve(name: str, value: object) -> Curve | None:
    """Return a curve from plain lists; the row at rest, all zeros, may be there.

    Raises:
        InputError: no rows of three numbers, too few, or not rising.
    """
    if value is None or value == "":
        return None
    accepted = f"accepted: at least {_FEWEST} rows of [rad/s, N, N m], all rising"
    if not isinstance(value, list | tuple) or len(value) > _MOST:
        raise InputError(f"{name}: {shown(value)}; {accepted}")
    rows: list[tuple[float, float, float]] = []
    for i, row in enumerate(value):
        if not isinstance(row, list | tuple) or len(row) != len(_COLUMNS):
            raise InputError(f"{name}[{i}]: {shown(row)}; {accepted}")
        if i == 0 and all(x == 0 for x in row):
            continue
        speed, thrust, torque = (
            check_number(f"{name}[{i}].{column}", x, unit, bounds)
            for x, (column, unit, bounds) in zip(row, _COLUMNS, strict=True)
        )
        rows.append((speed, thrust, torque))
    if len(rows) < _FEWEST:
        raise InputError(f"{name}: {len(rows)} rows; {accepted}")
    for i, (last, row) in enumerate(itertools.pairwise(rows)):
        if not all(after > before for before, after in zip(last, row, strict=True)):
            raise InputError(
                f"{name}[{i + 1}]: {shown(list(row))} after {shown(list(last))}; {accepted}"
            )
    return tuple(rows)


@dataclass(frozen=True)
class PlainPropeller:
    """Thrust k_T omega^2 and drag torque k_Q omega^2, or both from a curve."""

    k_thrust: float
    """[N s^2/rad^2]"""
    k_torque: float
    """[N m s^2/rad^2]"""
    curve: Curve | None = None

    @property
    def omega_max(self) -> float:
        """Highest speed that is known [rad/s]: the curve's last, else without limit."""
        return math.inf if self.curve is None else self.curve[-1][0]

    @property
    def source(self) -> str:
        """The parameter that its thrust is from, as errors name it."""
        return "propeller.k_thrust" if self.curve is None else "propeller.curve"

    def thrust(self, omega: ArrayLike) -> Array:
        """Return thrust [N] at speeds [rad/s] from 0 to omega_max."""
        return self._of(omega, self.k_thrust, 1)

    def torque(self, omega: ArrayLike) -> Array:
        """Return drag torque [N m] at speeds [rad/s] from 0 to omega_max."""
        return self._of(omega, self.k_torque, 2)

    def speed_for(self, thrust: float) -> float:
        """Return the speed [rad/s] that gives a thrust [N]; beyond the curve, as at its end."""
        if self.curve is None:
            return math.sqrt(thrust / self.k_thrust)
        table = np.array(self.curve)
        roots = np.sqrt(table[:, 1])
        return float(np.interp(math.sqrt(thrust), roots, table[:, 0]))

    def _of(self, omega: ArrayLike, coefficient: float, column: int) -> Array:
        speed = np.asarray(omega, dtype=float)
        if self.curve is None:
            return np.asarray(coefficient * speed**2)
        table = np.array(self.curve)
        # The coefficient changes slowly with speed: it is interpolated, and held below the curve.
        shares = PchipInterpolator(table[:, 0], table[:, column] / table[:, 0] ** 2)
        return np.asarray(shares(np.clip(speed, table[0, 0], table[-1, 0])) * speed**2)


IMPACTS = ("rigid", "breaks", "folds")
"""Behaviour of a plain propeller in a strike: it stays whole, breaks, or folds as a nodus."""
_SAME_LENGTH = 5e-4
"""m: two radii that differ by less are the same."""


@dataclass(frozen=True)
class PropellerChoice:
    """Which propeller is mounted: a Tombo configuration, or a plain one (k_thrust or curve)."""

    conf: int = param(
        13, "1", (0, 9999), "configuration of the paper's Table I, 0 is rigid, or of `library`"
    )
    law: str = field(default="repaired", metadata={"doc": "published, repaired or consistent"})
    library: str = field(
        default="", metadata={"doc": "folder with own configurations, blades, materials, or empty"}
    )
    k_thrust: float = param(
        0.0,
        "N s^2/rad^2",
        (0.0, 1e-2),
        "plain propeller: thrust over the square of its speed; 0: none",
    )
    k_torque: float = param(
        0.0,
        "N m s^2/rad^2",
        (0.0, 1e-3),
        "plain propeller: drag torque over the square of its speed",
    )
    curve: tuple[tuple[float, float, float], ...] | None = structure(
        read_curve,
        "plain propeller, in place of k_thrust and k_torque: rows of speed [rad/s], thrust [N], "
        "drag torque [N m], all of them rising",
    )
    radius: float = param(
        0.0, "m", (0.0, 0.5), "tip radius; 0: the configuration's blade, or vehicle.rotor_radius"
    )
    on_impact: str = field(
        default="",
        metadata={
            "doc": "plain propeller that strikes: rigid (the default: pushed as the paper's rigid "
            "one, stays whole), breaks, or folds as the nodus of `conf`"
        },
    )
    matched: float = param(
        0.01,
        "1",
        (0.0, 0.5),
        "standard deviation of thrust between the propellers of one vehicle, share of it",
        "estimated, because: a lab balances a set and pairs it on a stand; Table III's deviation "
        "(17 % for the rigid propeller, too) is of readings of one propeller",
    )

    @property
    def plain(self) -> bool:
        """Whether it is a plain propeller."""
        return self.k_thrust > 0.0 or self.curve is not None

    @property
    def folds(self) -> bool:
        """Whether a nodus folds when it strikes."""
        if self.plain:
            return self.on_impact == "folds"
        return not mounted_configuration(self).rigid


def library_of(choice: PropellerChoice) -> Library:
    """Return the built-in library, with the one of the choice's folder over it.

    Raises:
        InputError: the folder does not exist, or its content does not fit.
    """
    if not isinstance(choice.library, str):
        raise InputError(
            f"propeller.library: {shown(choice.library)}; accepted: a folder, or empty"
        )
    if not choice.library:
        return read_library()
    folder = Path(choice.library)
    if not folder.is_dir():
        raise InputError(
            f"propeller.library: no folder '{choice.library}'; accepted: a folder with "
            "configurations.yaml, or empty"
        )
    return read_library(folder)


def mounted_configuration(choice: PropellerChoice) -> Configuration:
    """Return the configuration that is mounted.

    Raises:
        InputError: it is in neither Table I nor the library, or the library can't be read.
    """
    known = library_of(choice).configurations
    if choice.conf not in known:
        raise InputError(
            f"propeller.conf: unknown configuration {choice.conf}; accepted: {shown_names(known)}"
        )
    return known[choice.conf]


def check_choice(choice: PropellerChoice) -> None:
    """Refuse a choice that mixes settings of two kinds of propellers.

    Raises:
        InputError: names the two settings that contradict each other.
    """
    if choice.on_impact not in ("", *IMPACTS):
        raise unknown_name("propeller.on_impact", choice.on_impact, IMPACTS)
    if not choice.plain:
        if choice.k_torque > 0.0 or choice.on_impact:
            name = "k_torque" if choice.k_torque > 0.0 else "on_impact"
            raise InputError(
                f"propeller.{name}: {getattr(choice, name)}: the propeller is configuration "
                f"{choice.conf}; accepted: with k_thrust or curve only"
            )
        mounted_configuration(choice)
        return
    if choice.curve is not None and (choice.k_thrust > 0.0 or choice.k_torque > 0.0):
        raise InputError("propeller.curve and propeller.k_thrust: accepted: one of them")
    if choice.curve is None and choice.k_torque <= 0.0:
        raise InputError(
            "propeller.k_torque: missing next to k_thrust; accepted: a number above 0 "
            "[N m s^2/rad^2] (a sixtieth of k_thrust times 1 m is common)"
        )
    if choice.on_impact == "folds" and mounted_configuration(choice).rigid:
        raise InputError(
            f"propeller.on_impact: folds, but configuration {choice.conf} is rigid; accepted: "
            "with a conf that has a nodus"
        )


def thrust_map_of(choice: PropellerChoice) -> ThrustMap | PlainPropeller:
    """Return thrust and torque over speed of the mounted propeller.

    Raises:
        InputError: as `check_choice`.
    """
    check_choice(choice)
    if choice.plain:
        return PlainPropeller(choice.k_thrust, choice.k_torque, choice.curve)
    return thrust_map(mounted_configuration(choice), law=choice.law)


def mounted_rotors(choice: PropellerChoice, vehicle: VehicleParams) -> RotorMaps:
    """Return the table of a vehicle's rotors with the mounted propeller.

    Raises:
        InputError: as `thrust_map_of` and `rotor_maps`.
    """
    if choice.library:  # its files may change
        return rotor_maps(thrust_map_of(choice), vehicle)
    return deepcopy(_rotors(choice, vehicle))


@lru_cache(maxsize=16)  # the flights of a campaign have the same ones
def _rotors(choice: PropellerChoice, vehicle: VehicleParams) -> RotorMaps:
    return rotor_maps(thrust_map_of(choice), vehicle)


def mounted_vehicle(vehicle: VehicleParams, choice: PropellerChoice) -> VehicleParams:
    """Return the vehicle with the tip radius of its propeller.

    Where the vehicle has the default's radius, none was given, and it is the propeller's.

    Raises:
        InputError: radii contradict each other, or rotor discs overlap.
    """
    check_choice(choice)
    default = next(f.default for f in fields(VehicleParams) if f.name == "rotor_radius")
    radii = {"vehicle.rotor_radius": vehicle.rotor_radius, "propeller.radius": choice.radius}
    radii = {name: r for name, r in radii.items() if r not in (0.0, default)}
    true = choice.radius or vehicle.rotor_radius
    source = "propeller.radius"
    if not choice.plain:
        configuration = mounted_configuration(choice)
        true, source = configuration.blade.tip_radius_m, f"the blade of {configuration.label}"
    for name, radius in radii.items():
        if abs(radius - true) > _SAME_LENGTH:
            raise InputError(
                f"{name}: {radius:g} m, but {source} has {true:g} m; accepted: the same radius, "
                "or a plain propeller (propeller.k_thrust)"
            )
    if abs(vehicle.rotor_radius - true) > _SAME_LENGTH:
        vehicle = replace(vehicle, rotor_radius=true)
    shortest = math.sqrt(2.0) * vehicle.rotor_radius
    if vehicle.arm_length < shortest:
        raise InputError(
            f"vehicle.arm_length: {vehicle.arm_length:g} m: discs of {vehicle.rotor_radius:g} m "
            f"radius overlap; accepted: at least {shortest:.4f} m, or a smaller propeller"
        )
    if vehicle.nodus_radius >= vehicle.rotor_radius:
        raise InputError(
            f"vehicle.nodus_radius: {vehicle.nodus_radius:g} m; accepted: less than the tip "
            f"radius, {vehicle.rotor_radius:g} m"
        )
    return vehicle


def recovery_time(propeller: PropellerChoice) -> float:
    """Return how long a folded propeller needs for 90 % of its thrust [s]; 0: it does not fold."""
    if not propeller.folds:
        return 0.0
    known = library_of(propeller).configurations.values()
    return propeller_performance(mounted_configuration(propeller), known)["recovery_s"]


def propeller_performance(
    chosen: Configuration, known: Iterable[Configuration]
) -> dict[str, float]:
    """Return Table III's figures that the simulation uses for a configuration.

    A configuration without measurements, such as 1 to 4, gets the mean over the measured ones with
    the same silicone, or over all. The rigid propeller has no recovery.

    Args:
        chosen: the configuration.
        known: configurations whose measurements may be used instead.

    Returns:
        collision_force_N, recovery_s (0 for the rigid one).
    """
    others = tuple(known)
    performance = {}
    for name in ("collision_force_N", "recovery_s"):
        value = getattr(chosen.measured, name) if chosen.measured is not None else None
        if value is None:
            value = 0.0 if chosen.nodus is None else _same_matrix_mean(chosen, others, name)
        performance[name] = float(value)
    return performance


def _same_matrix_mean(chosen: Configuration, known: Iterable[Configuration], name: str) -> float:
    """Return the mean of a measured figure over the same silicone, else over every nodus."""
    same, every = [], []
    for other in known:
        value = getattr(other.measured, name) if other.measured is not None else None
        if other.nodus is None or chosen.nodus is None or value is None:
            continue
        every.append(float(value))
        if other.nodus.matrix.name == chosen.nodus.matrix.name:
            same.append(float(value))
    values = same or every
    return sum(values) / len(values)
