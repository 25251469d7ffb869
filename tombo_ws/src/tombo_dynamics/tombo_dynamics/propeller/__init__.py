"""The Tombo propeller: from materials and blade to thrust, torque and deformation.

    >>> from tombo_dynamics.propeller import RPM, evaluate
    >>> evaluate(13, 2000 * RPM).thrust_N                         # 0.613 N

`docs/propeller.md` has the equations, their sources, and their comparison with measurements.
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
from tombo_dynamics.propeller.nodus import Moduli, nodus_moduli
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
from tombo_dynamics.propeller.thrust_map import ThrustMap, speed_of_maximum_thrust, thrust_map

__all__ = [
    "DEFAULT_LAW",
    "LAWS",
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
    "RotorInertia",
    "Surroundings",
    "ThrustMap",
    "configuration",
    "configurations",
    "evaluate",
    "evaluate_rows",
    "nodus_moduli",
    "parameter_row",
    "read_library",
    "rotor_inertia",
    "speed_of_maximum_thrust",
    "thrust_map",
    "valid_speed",
]
