"""The parts of a propeller: frozen records, as read from the data files.

A field's name has its unit, as in the data files; the laws get SI from `laws.parameters`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import AIR_DENSITY


def quantity(unit: str, low: float, high: float, **default: Any) -> Any:
    """Declare a numeric field with its unit and its lowest and highest accepted value."""
    return dataclasses.field(metadata={"unit": unit, "bounds": (low, high)}, **default)


@dataclass(frozen=True)
class Matrix:
    """A silicone: tensile test as secant modulus over strain."""

    name: str
    poisson_ratio: float = quantity("1", 0.0, 0.5)
    strain_percent: tuple[float, ...] = quantity("%", 0.0, 1000.0)
    secant_modulus_MPa: tuple[float, ...] = quantity("MPa", 1e-6, 1e6)

    def __post_init__(self) -> None:
        """Refuse a test that a cubic can't be fitted to."""
        if len(self.strain_percent) != len(self.secant_modulus_MPa):
            raise InputError(
                f"matrix {self.name}: {len(self.strain_percent)} strains and "
                f"{len(self.secant_modulus_MPa)} secant moduli; accepted: one modulus a strain"
            )
        if len(set(self.strain_percent)) < 4:
            raise InputError(
                f"matrix {self.name}: {len(set(self.strain_percent))} different strains; "
                "accepted: 4 or more, a cubic is fitted to them"
            )


@dataclass(frozen=True)
class Fibre:
    """A fibre: elastic moduli along and across it."""

    name: str
    youngs_modulus_MPa: float = quantity("MPa", 1e-3, 1e7)
    shear_modulus_MPa: float = quantity("MPa", 1e-3, 1e7)


@dataclass(frozen=True)
class Nodus:
    """The joint's composite: fibres along the span in a matrix."""

    matrix: Matrix
    fibre: Fibre
    fibres: int = quantity("1", 0, 1000)
    fibre_diameter_mm: float = quantity("mm", 0.0, 10.0)
    length_mm: float = quantity("mm", 0.1, 100.0)


@dataclass(frozen=True)
class BladeSegment:
    """A stretch of the blade with its polynomials, highest power first, x in metres."""

    start_m: float = quantity("m", 0.0, 1.0)
    end_m: float = quantity("m", 0.0, 1.0)
    depth_m: tuple[float, ...] = quantity("m", -1e9, 1e9)
    pitch_deg: tuple[float, ...] = quantity("deg", -1e9, 1e9)


@dataclass(frozen=True)
class BladeSection:
    """Force coefficients of every section over its angle of attack theta [deg].

    C_L = lift_mean + lift_swing sin(lift_rate theta + lift_phase) and
    C_D = drag_mean + drag_swing cos(drag_rate theta + drag_phase), fitted between the lowest and
    the highest angle.
    """

    lift_mean: float = quantity("1", -10.0, 10.0)
    lift_swing: float = quantity("1", -10.0, 10.0)
    lift_rate: float = quantity("1", 0.1, 10.0)
    lift_phase_deg: float = quantity("deg", -180.0, 180.0)
    drag_mean: float = quantity("1", -10.0, 10.0)
    drag_swing: float = quantity("1", -10.0, 10.0)
    drag_rate: float = quantity("1", 0.1, 10.0)
    drag_phase_deg: float = quantity("deg", -180.0, 180.0)
    lowest_deg: float = quantity("deg", -90.0, 0.0)
    highest_deg: float = quantity("deg", 0.0, 180.0)


@dataclass(frozen=True)
class Joint:
    """Where the nodus sits on the blade, what stiffens it and where the wing pulls on it."""

    outer_radius_m: float = quantity("m", 0.001, 1.0)
    section_area_mm2: float = quantity("mm^2", 1e-3, 1e5)
    flap_second_moment_mm4: float = quantity("mm^4", 1e-3, 1e9)
    lag_second_moment_mm4: float = quantity("mm^4", 1e-3, 1e9)
    torsion_constant_m4: float = quantity("m^4", 1e-15, 1.0)
    lift_arm_mm: float = quantity("mm", -100.0, 100.0)
    drag_arm_mm: float = quantity("mm", -100.0, 100.0)
    wing_mass_kg: float = quantity("kg", 1e-6, 10.0)
    wing_centroid_m: float = quantity("m", 1e-3, 1.0)
    flap_offset_rad: float = quantity("rad", -1.0, 1.0)
    lag_offset_rad: float = quantity("rad", -1.0, 1.0)


@dataclass(frozen=True)
class PublishedTorsion:
    """What only the law `published` uses: the torsion terms of the authors' program."""

    fibre_count: int = quantity("1", 0, 1000)
    fibre_modulus_ratio: float = quantity("1", 1.0, 100.0)
    torsion_term_m4: float = quantity("m^4", 1e-15, 1.0)
    torsion_area_mm2: float = quantity("mm^2", 1e-3, 1e5)
    camber_length_mm: float = quantity("mm", 1e-3, 1e4)
    pivot_mm: tuple[float, ...] = quantity("mm", -1000.0, 1000.0)


@dataclass(frozen=True)
class Blade:
    """A blade: shape, section coefficients and joint. Spans are from the hub's centre."""

    name: str
    pieces: tuple[BladeSegment, ...]
    section: BladeSection
    joint: Joint
    published: PublishedTorsion | None = None
    tip_radius_m: float = quantity("m", 0.001, 2.0, default=0.1111)
    thickness_at_m: tuple[float, ...] = quantity("m", 0.0, 1.0, default=())
    thickness_mm: tuple[float, ...] = quantity("mm", 0.0, 100.0, default=())

    def __post_init__(self) -> None:
        """Refuse a shape with gaps, or a nodus that ends outside of it."""
        if not self.pieces:
            raise InputError(f"blade {self.name}: no pieces; accepted: one or more")
        for before, after in zip(self.pieces, self.pieces[1:], strict=False):
            if before.end_m != after.start_m:
                raise InputError(
                    f"blade {self.name}: a piece starts at {after.start_m} m where the one before "
                    f"ends at {before.end_m} m; accepted: pieces that join"
                )
        for piece in self.pieces:
            if not piece.start_m < piece.end_m:
                raise InputError(
                    f"blade {self.name}: piece from {piece.start_m} m to {piece.end_m} m; "
                    "accepted: start below end"
                )
        low, high = self.pieces[0].start_m, self.pieces[-1].end_m
        if not low < self.joint.outer_radius_m < high:
            raise InputError(
                f"blade {self.name}: joint.outer_radius_m {self.joint.outer_radius_m} is outside "
                f"of the blade; accepted: between {low} and {high} m"
            )
        if len(self.thickness_at_m) != len(self.thickness_mm):
            raise InputError(
                f"blade {self.name}: {len(self.thickness_at_m)} stations and "
                f"{len(self.thickness_mm)} thicknesses; accepted: one thickness a station"
            )


@dataclass(frozen=True)
class Measurement:
    """Measured at 2000 rpm (Table III); `printed_lift_over_drag` is the authors' simulation."""

    thrust_N: float = quantity("N", 0.0, 1e3)
    thrust_dev_N: float = quantity("N", 0.0, 1e3)
    collision_force_N: float | None = quantity("N", 0.0, 1e5, default=None)
    recovery_s: float | None = quantity("s", 0.0, 100.0, default=None)
    printed_lift_over_drag: float | None = quantity("1", 0.0, 100.0, default=None)
    noise_dB: float | None = quantity("dB", 0.0, 200.0, default=None)


@dataclass(frozen=True)
class CollisionPosition:
    """Highest force of a strike at a distance from the hub (Table II, Conf. 13, 2500 rpm)."""

    r_mm: float = quantity("mm", 0.0, 1000.0)
    force_N: float = quantity("N", 0.0, 1e5)
    thickness_mm: float = quantity("mm", 0.0, 100.0)


@dataclass(frozen=True)
class Configuration:
    """A propeller: a blade with a nodus, or rigid."""

    number: int
    blade: Blade
    nodus: Nodus | None = None
    edge: str | None = None
    """Matrix of the soft leading edge, if there is one; the model does not use it."""
    printed_E_N_MPa: float | None = quantity("MPa", 0.0, 1e6, default=None)
    printed_G_N_MPa: float | None = quantity("MPa", 0.0, 1e6, default=None)
    measured: Measurement | None = None
    name: str = ""
    """Its name where the number is not enough, e.g. one derived from another."""

    @property
    def label(self) -> str:
        """Its name, or its number."""
        return self.name or f"configuration {self.number}"

    @property
    def rigid(self) -> bool:
        """Whether the propeller has no nodus."""
        return self.nodus is None


@dataclass(frozen=True)
class Surroundings:
    """Air and gravity. The defaults are the paper's."""

    air_density_kg_m3: float = quantity("kg/m^3", 0.01, 2000.0, default=AIR_DENSITY)
    gravity_m_s2: float = quantity("m/s^2", 0.0, 100.0, default=9.8)


STANDARD = Surroundings()
