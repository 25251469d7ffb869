"""The Tombo propeller: from materials and blade to thrust, torque and deformation.

    >>> from tombo_dynamics.propeller import RPM, configuration, evaluate, sweep, with_nodus
    >>> evaluate(13, 2000 * RPM).thrust_N                         # 0.613 N
    >>> stiff = with_nodus(configuration(13), fibres=8, length_mm=10.0)
    >>> grid = sweep([configuration(13), stiff], 2000 * RPM, length_mm=[8, 12])
    >>> grid.thrust_N.shape                                       # (2, 2)
    >>> speed_for_thrust([5, 13], 1.5) / RPM                      # rpm

`docs/propeller.md` has the equations, their sources, and what measurement says against them.
"""

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.blade import RotorInertia, rotor_inertia
from tombo_dynamics.propeller.derive import with_joint, with_nodus, with_section
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
from tombo_dynamics.propeller.sweep import OperationGrid, sweep
from tombo_dynamics.propeller.thrust_map import (
    Peak,
    ThrustMap,
    speed_for_thrust,
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
    "OperationGrid",
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
    "speed_for_thrust",
    "speed_of_maximum_thrust",
    "sweep",
    "thrust_map",
    "thrust_peak",
    "valid_speed",
    "with_joint",
    "with_nodus",
    "with_section",
]
