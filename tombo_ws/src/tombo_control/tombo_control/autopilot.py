"""The memory of estimator and cascade: one flat array `a`, and the index of each of its parts.

`a[A.position + 2]` is the estimated height, `a[G.position_p]` a gain of the cascade,
`a[E.mocap_rate]` a parameter of the estimator; Python code uses `part(a, "position")`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tombo_control.params import ControlParams, EstimatorParams
from tombo_dynamics.jit import compiled
from tombo_dynamics.params import as_tuple, tuple_type
from tombo_dynamics.vehicle import VehicleParams

Array = NDArray[np.float64]

HISTORY_TICKS = 512
"""Length of the ring of past estimates: mocap samples up to half a second late are used."""

IDLE, TAKEOFF, HOVER, APPROACH, REACT, HOLD, LAND, LANDED, BLIND = range(9)
"""Mode numbers, as in `tombo_msgs/MissionStatus`."""
PHASE_NAMES = (
    "idle",
    "takeoff",
    "hover",
    "approach",
    "react",
    "hold",
    "land",
    "landed",
    "descend_blind",
)


class _Autopilot(NamedTuple):
    """Index of the first element of each part. `map` is ENU, body is FLU, SI units."""

    position: int
    """3: estimated position in map [m]."""
    velocity: int
    """3: estimated velocity in map [m/s]."""
    attitude: int
    """4: estimated attitude, xyzw, map from body."""
    gyro_bias: int
    """3: estimated gyro bias [rad/s]."""
    accel_bias: int
    """3: estimated accelerometer bias [m/s^2], body frame."""
    rates: int
    """3: body rates, bias removed [rad/s]."""
    leg: int
    """14: the reference being flown: start (3), cruise velocity (3), begin [s], end [s], ramp [s],
    yaw now [rad]; of a turn: yaw at the begin [rad], rate [rad/s], how long [s], ramp [s]."""
    position_setpoint: int
    """3: [m], map."""
    velocity_setpoint: int
    """3: [m/s], map."""
    velocity_reference: int
    """3: velocity of the reference, fed forward [m/s], map."""
    acceleration_setpoint: int
    """3: feed-forward of the reference [m/s^2], map."""
    velocity_integral: int
    """3: acceleration of the velocity integral [m/s^2], map."""
    previous_velocity: int
    """3: estimate at the last run of the position loop [m/s]."""
    attitude_setpoint: int
    """4: xyzw, map from body."""
    thrust_setpoint: int
    """1: collective thrust [N]."""
    rates_setpoint: int
    """3: [rad/s], body."""
    rate_integral: int
    """3: angular acceleration of the rate integral [rad/s^2]."""
    rate_filtered: int
    """3: low-passed body rates, for the derivative [rad/s]."""
    saturated: int
    """3: -1, 0, +1: the allocation could not give more roll, pitch, yaw in that direction."""
    torque_setpoint: int
    """3: angular acceleration [rad/s^2], then torque [N m], asked of the rotors, body."""
    rotor_thrust: int
    """4: thrust asked of each rotor [N]."""
    command: int
    """4: rotor speeds asked for [rad/s]."""
    mode: int
    """3: mode asked for, mode flown, time of capture of the last mocap sample [s]."""
    history: int
    """512 x 8: position (3), attitude (4), tick of the last states, a ring."""


AUTOPILOT_SIZES = _Autopilot(
    3, 3, 4, 3, 3, 3, 14, 3, 3, 3, 3, 3, 3, 4, 1, 3, 3, 3, 3, 3, 4, 4, 3, 8 * HISTORY_TICKS
)


def _starts() -> list[int]:
    starts = [0]
    for size in AUTOPILOT_SIZES:
        starts.append(starts[-1] + size)
    return starts


_STARTS = _starts()
A = _Autopilot(*_STARTS[:-1])
"""Where each part of the autopilot begins in `a`."""
ControlIndex: Any = tuple_type(ControlParams, "ControlIndex", __name__)
VehicleIndex: Any = tuple_type(VehicleParams, "VehicleIndex", __name__)
EstimatorIndex: Any = tuple_type(EstimatorParams, "EstimatorIndex", __name__)
_GAINS = _STARTS[-1]
_OBSERVER = _GAINS + len(ControlIndex._fields)
_NOMINAL = _OBSERVER + len(EstimatorIndex._fields)
AUTOPILOT_SIZE = _NOMINAL + len(VehicleIndex._fields)
G: Any = ControlIndex(*range(_GAINS, _OBSERVER))
"""Where each parameter of the cascade is in `a`."""
E: Any = EstimatorIndex(*range(_OBSERVER, _NOMINAL))
"""Where each parameter of the estimator is in `a`."""
N: Any = VehicleIndex(*range(_NOMINAL, AUTOPILOT_SIZE))
"""Where each parameter of the nominal vehicle, the one that is controlled for, is in `a`."""


def new_autopilot(
    control: ControlParams,
    estimator: EstimatorParams,
    vehicle: VehicleParams,
    position: Array,
    attitude: Array,
) -> Array:
    """Return the memory of an autopilot at rest, at a known position (3) and attitude (4)."""
    memory = np.zeros(AUTOPILOT_SIZE)
    part(memory, "position")[:] = position
    part(memory, "attitude")[:] = attitude
    part(memory, "attitude_setpoint")[:] = attitude
    part(memory, "position_setpoint")[:] = position
    part(memory, "leg")[:3] = position
    part(memory, "history").reshape(-1, 8)[:, 7] = -1.0
    memory[_GAINS:_OBSERVER] = as_tuple(control, ControlIndex)
    memory[_OBSERVER:_NOMINAL] = as_tuple(estimator, EstimatorIndex)
    memory[_NOMINAL:] = as_tuple(vehicle, VehicleIndex)
    return memory


@compiled
def restart_estimate(a: Array, position: Array, velocity: Array, attitude: Array) -> None:
    """Begin at a position (3), velocity (3) and attitude (4), as `new_autopilot` does."""
    for i in range(_GAINS):
        a[i] = 0.0
    for i in range(3):
        a[A.position + i] = position[i]
        a[A.velocity + i] = velocity[i]
    for i in range(4):
        a[A.attitude + i] = attitude[i]
    for tick in range(HISTORY_TICKS):
        a[A.history + 8 * tick + 7] = -1.0


def part(memory: Array, name: str) -> Array:
    """Return a view of a named part of an autopilot's memory."""
    start = getattr(A, name)
    view: Array = memory[start : start + getattr(AUTOPILOT_SIZES, name)]
    return view
