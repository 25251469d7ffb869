"""The Tombo propeller: from materials and blade to thrust, torque and deformation.

    >>> from tombo_dynamics.propeller import RPM, evaluate
    >>> evaluate(13, 2000 * RPM).thrust_N                         # 0.613 N
    >>> evaluate(13, 2000 * RPM, length_mm=[8, 12]).thrust_N      # (2,)

`docs/propeller.md` has the equations, their sources, and what measurement says against them.
"""

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.blade import RotorInertia, rotor_inertia
from tombo_dynamics.propeller.evaluate import (
    RPM,
    SPEED_LIMIT,
    Operation,
    evaluate,
    evaluate_rows,
    valid_speed,
)
from tombo_dynamics.propeller.laws.parameters import DEFAULT_LAW, LAWS, SCALARS, parameter_row
from tombo_dynamics.propeller.library import Library, configuration, configurations, read_library
from tombo_dynamics.propeller.parameter_rows import parameter_rows
from tombo_dynamics.propeller.quantities import QUANTITIES, Moduli, nodus_moduli
from tombo_dynamics.propeller.records import (
    STANDARD,
    Blade,
    Configuration,
    Fibre,
    Joint,
    Matrix,
    Measurement,
    Nodus,
    Surroundings,
)
from tombo_dynamics.propeller.thrust_map import (
    Peak,
    ThrustMap,
    speed_of_maximum_thrust,
    thrust_map,
    thrust_peak,
)

__all__ = [
    "DEFAULT_LAW",
    "LAWS",
    "QUANTITIES",
    "RPM",
    "SCALARS",
    "SPEED_LIMIT",
    "STANDARD",
    "Blade",
    "Configuration",
    "Fibre",
    "InputError",
    "Joint",
    "Library",
    "Matrix",
    "Measurement",
    "Moduli",
    "Nodus",
    "Operation",
    "Peak",
    "RotorInertia",
    "Surroundings",
    "ThrustMap",
    "configuration",
    "configurations",
    "evaluate",
    "evaluate_rows",
    "nodus_moduli",
    "parameter_row",
    "parameter_rows",
    "read_library",
    "rotor_inertia",
    "speed_of_maximum_thrust",
    "thrust_map",
    "thrust_peak",
    "valid_speed",
]
