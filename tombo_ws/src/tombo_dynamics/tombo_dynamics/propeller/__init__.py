"""The Tombo propeller: from materials and blade to thrust, torque and deformation.

    >>> from tombo_dynamics.propeller import configuration, evaluate, thrust_map
    >>> evaluate(configuration(13), 209.44).thrust_N      # 2000 rpm: 0.613 N
    >>> thrust_map(configuration(13)).speed_for_thrust(3.0)

`docs/propeller.md` has the equations, their sources, and what measurement says against them.
"""

from tombo_dynamics.propeller.evaluate import (
    SPEED_LIMIT,
    Operation,
    evaluate,
    evaluate_rows,
    valid_speed,
)
from tombo_dynamics.propeller.laws.names import DEFAULT_LAW, LAWS
from tombo_dynamics.propeller.laws.parameters import SCALARS, parameter_row
from tombo_dynamics.propeller.library import (
    Library,
    configuration,
    configurations,
    read_library,
)
from tombo_dynamics.propeller.moduli import Moduli, nodus_moduli
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
from tombo_dynamics.propeller.rotor_inertia import RotorInertia, rotor_inertia
from tombo_dynamics.propeller.thrust_map import ThrustMap, speed_of_maximum_thrust, thrust_map

__all__ = [
    "DEFAULT_LAW",
    "LAWS",
    "SCALARS",
    "SPEED_LIMIT",
    "STANDARD",
    "Blade",
    "Configuration",
    "Fibre",
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
