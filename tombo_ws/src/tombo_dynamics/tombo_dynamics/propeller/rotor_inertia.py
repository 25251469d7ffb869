"""What a rotor's moment of inertia is made of: wings, blade roots and the motor's bell."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.propeller.records import Blade
from tombo_dynamics.propeller.wing_mass import volume_moments

BLADES = 2
BELL_MASS_KG = 0.025
"""Estimated, because: an X2212-class motor weighs about 57 g, its bell and magnets under half."""
BELL_RADIUS_M = 0.0125
"""Estimated, because: the bell's outer diameter is about 27.5 mm and its mass sits in the ring."""


@dataclass(frozen=True)
class RotorInertia:
    """Moment of inertia about the rotor's axis, by part [kg m^2]."""

    wings: float
    roots: float
    bell: float

    @property
    def total(self) -> float:
        """Sum of the parts [kg m^2]."""
        return self.wings + self.roots + self.bell


def rotor_inertia(blade: Blade) -> RotorInertia:
    """Estimate the rotor's moment of inertia about its axis.

    Wings: 2 m_w (x_c^2 + spread^2) with the published mass and centroid; the spread is that of
    depth times thickness (Table II, constant beyond its ends) along the span. That distribution
    puts the centroid of the nine-inch blade at 66.4 mm, the published one is 66.64 mm.
    Roots: the same mass per length carried on from the wing's root to the blade's start, at the
    wing's own density; the nodus' silicone is taken as heavy. The hub inside is neglected.
    Bell: a ring of BELL_MASS_KG at BELL_RADIUS_M.
    Folding moves the wings inwards and is not in it.

    Raises:
        InputError: no Blade.
    """
    if not isinstance(blade, Blade):
        raise InputError(
            f"blade {shown(blade)}; accepted: a Blade, such as configuration(13).blade or one of "
            "read_library().blades"
        )
    joint = blade.joint
    wing_mass, wing_centroid, wing_square = volume_moments(
        blade, joint.outer_radius_m, blade.pieces[-1].end_m
    )
    root_mass, _, root_square = volume_moments(
        blade, blade.pieces[0].start_m, joint.outer_radius_m
    )
    density = joint.wing_mass_kg / wing_mass
    spread = wing_square - wing_centroid**2
    return RotorInertia(
        wings=float(BLADES * joint.wing_mass_kg * (joint.wing_centroid_m**2 + spread)),
        roots=float(BLADES * density * root_mass * root_square),
        bell=BELL_MASS_KG * BELL_RADIUS_M**2,
    )
