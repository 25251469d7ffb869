"""The request: a vehicle, and limits for its propeller."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import validate
from tombo_dynamics.propeller import Blade, rotor_inertia
from tombo_dynamics.vehicle import VehicleParams
from tombo_propeller.design.limits import DesignLimits

LAWS = ("repaired", "consistent")
"""The authors' program, law `published`, takes six fibres whatever the nodus has."""
S500 = "s500"
_LONGEST_ARM_MM = 1000.0
_DRIVES_KG = 0.34
_DRIVES_XX, _DRIVES_ZZ = 0.0098, 0.0196
"""kg m^2: share of the S500's inertia of four drive units of 85 g at 0.24 m; see vehicle.py."""


class Criterion(NamedTuple):
    """A figure that a design is evaluated by."""

    name: str
    label: str
    unit: str
    more_is_better: bool

    @property
    def limit(self) -> str:
        """The field of `DesignLimits` that limits it."""
        return f"{'min' if self.more_is_better else 'max'}_{self.name}"


QUANTITIES = (
    Criterion("thrust_margin", "thrust margin", "", True),
    Criterion("collision_force_N", "collision force", "N", False),
    Criterion("recovery_s", "recovery time", "s", False),
    Criterion("noise_dB", "noise", "dB", False),
    Criterion("lift_over_drag", "lift over drag", "", True),
)
"""Column by column, in every table of candidates.

The thrust margin is one propeller's highest usable thrust over a quarter of the weight. Collision
force, recovery time and noise are Table III's, at 2000 rpm; lift over drag is at hover.
"""
NAMES = tuple(q.name for q in QUANTITIES)
MEASURED = ("collision_force_N", "recovery_s", "noise_dB")
"""Quantities without a physical model: measured, or predicted from the measured ones."""


@dataclass(frozen=True)
class DesignLimit:
    """A limit on one quantity."""

    quantity: Criterion
    value: float

    @property
    def text(self) -> str:
        """The limit in words, as `collision force at most 150 N`."""
        side = "at least" if self.quantity.more_is_better else "at most"
        return f"{self.quantity.label} {side} {self.value:g} {self.quantity.unit}".rstrip()


@dataclass(frozen=True, kw_only=True)
class DesignRequest(DesignLimits):
    """Vehicle, limits, and the law that predicts."""

    arm_m: float = 0.24
    law: str = "repaired"
    extrapolate: bool = False
    """Whether predictions count outside of the tested range, too."""

    def __post_init__(self) -> None:
        """Refuse what can't be used.

        Raises:
            InputError: names the option, the value and the accepted ones.
        """
        super().__post_init__()
        if self.law == "published":
            raise InputError(
                "--law published: the authors' program takes six fibres whatever the nodus has, "
                f"so nothing can be designed with it; accepted: {', '.join(LAWS)}"
            )
        if self.law not in LAWS:
            raise unknown_name("--law", self.law, LAWS)

    @property
    def limits(self) -> tuple[DesignLimit, ...]:
        """The limits that are asked for, the thrust margin first."""
        asked = ((q, getattr(self, q.limit)) for q in QUANTITIES)
        return tuple(DesignLimit(q, float(value)) for q, value in asked if value is not None)


def arm_of(frame: str, blade: Blade) -> float:
    """Return the length of an arm [m] from `s500` or a length in millimetres.

    Raises:
        InputError: neither, or so short that neighbouring discs overlap.
    """
    shortest = 1e3 * math.sqrt(2.0) * blade.tip_radius_m
    if frame.strip().lower() == S500:
        arm = VehicleParams().arm_length
        if arm * 1e3 > shortest:
            return arm
    accepted = (
        f"accepted: {S500}, or the distance from centre to rotor axis in mm, "
        f"{math.ceil(shortest)} to {_LONGEST_ARM_MM:.0f} (the discs of {blade.name} must not "
        "overlap)"
    )
    try:
        length = float(frame)
    except ValueError:
        raise InputError(f"--frame {frame}: no frame and no length; {accepted}") from None
    if not shortest < length <= _LONGEST_ARM_MM:
        raise InputError(f"--frame {frame}: out of bounds; {accepted}")
    return length * 1e-3


def vehicle_for(request: DesignRequest, blade: Blade) -> VehicleParams:
    """Return the vehicle: the S500 with another mass and other arms.

    Of the S500's inertia the drives' share grows with the square of the arm, the hub's with the
    mass that is not in the drives. Battery and landing gear stay; the motors turn a tip as fast as
    the S500's.
    """
    plain = VehicleParams()
    reach = (request.arm_m / plain.arm_length) ** 2
    hub = max(request.mass_kg - _DRIVES_KG, 0.0) / (plain.mass - _DRIVES_KG)
    faster = plain.rotor_radius / blade.tip_radius_m
    across = max(_DRIVES_XX * reach + (plain.inertia_xx - _DRIVES_XX) * hub, 4e-3)
    vehicle = dataclasses.replace(
        plain,
        mass=request.mass_kg,
        arm_length=request.arm_m,
        inertia_xx=across,
        inertia_yy=across,
        inertia_zz=max(_DRIVES_ZZ * reach + (plain.inertia_zz - _DRIVES_ZZ) * hub, 4e-3),
        rotor_radius=blade.tip_radius_m,
        rotor_speed_min=plain.rotor_speed_min * faster,
        rotor_speed_max=plain.rotor_speed_max * faster,
        nodus_radius=blade.joint.outer_radius_m,
        rotor_inertia=rotor_inertia(blade).total,
    )
    validate(vehicle, "vehicle")
    return vehicle
