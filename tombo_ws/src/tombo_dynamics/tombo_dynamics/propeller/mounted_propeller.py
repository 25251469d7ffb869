"""Which propeller is mounted: the parameters of whoever needs its thrust map.

A Tombo propeller is a configuration of a library, whose model gives thrust and torque. A plain one
is any other: two coefficients, or a measured curve.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import param, structure
from tombo_dynamics.propeller.library import Library, read_library
from tombo_dynamics.propeller.plain_propeller import PlainPropeller, read_curve
from tombo_dynamics.propeller.records import Configuration
from tombo_dynamics.propeller.thrust_map import ThrustMap, thrust_map
from tombo_dynamics.rotor_maps import RotorMaps, rotor_maps
from tombo_dynamics.vehicle import VehicleParams

IMPACTS = ("rigid", "breaks", "folds")
"""What a plain propeller does when it strikes: it stays whole, breaks, or folds as a nodus."""
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
        InputError: there is no such folder, or what is in it does not fit.
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
            f"propeller.conf: there is no configuration {choice.conf}; accepted: {_ranges(known)}"
        )
    return known[choice.conf]


def _ranges(numbers: Iterable[int]) -> str:
    """Return rising whole numbers as text, neighbours as ranges: 0 to 13, 20."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(f"{a} to {b}" if a < b else f"{a}" for a, b in runs)


def check_choice(choice: PropellerChoice) -> None:
    """Refuse a choice that is half of one propeller and half of another.

    Raises:
        InputError: names what contradicts what.
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
            "propeller.k_torque: missing beside k_thrust; accepted: a number above 0 "
            "[N m s^2/rad^2] (a sixtieth of k_thrust times 1 m is common)"
        )
    if choice.on_impact == "folds" and mounted_configuration(choice).rigid:
        raise InputError(
            f"propeller.on_impact: folds, but configuration {choice.conf} is rigid; accepted: "
            "with a conf that has a nodus"
        )


def thrust_map_of(choice: PropellerChoice) -> ThrustMap | PlainPropeller:
    """Return thrust and torque over speed of what is mounted.

    Raises:
        InputError: as `check_choice`.
    """
    check_choice(choice)
    if choice.plain:
        return PlainPropeller(choice.k_thrust, choice.k_torque, choice.curve)
    return thrust_map(mounted_configuration(choice), law=choice.law)


def mounted_rotors(choice: PropellerChoice, vehicle: VehicleParams) -> RotorMaps:
    """Return the table of a vehicle's rotors with what is mounted.

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
    given = {"vehicle.rotor_radius": vehicle.rotor_radius, "propeller.radius": choice.radius}
    given = {name: r for name, r in given.items() if r not in (0.0, default)}
    true = choice.radius or vehicle.rotor_radius
    source = "propeller.radius"
    if not choice.plain:
        configuration = mounted_configuration(choice)
        true, source = configuration.blade.tip_radius_m, f"the blade of {configuration.label}"
    for name, radius in given.items():
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
