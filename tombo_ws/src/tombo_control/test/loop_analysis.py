"""Linear analysis of the cascade in hover: crossover and margins of each loop.

Each open loop is written as a product of frequency responses on the unit circle z = exp(i w T) of
the 1 ms tick: the code's tick is exact (integrators, derivative filter, holds, motor lag, a tick
of transport); only the aliases of the slower loops are left out, which their own holds make small.
A loop sees the closed loop inside it, not a model of that.

The estimator does not appear: fed by an IMU without error its states are the true ones, whatever
the latency of the mocap (`tombo_control.estimator`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_control.loops.loop_design import YawDrive, yaw_drive
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS, RATE_TICKS, ControlParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import VehicleParams

Complex = NDArray[np.complex128]
Loop = Callable[[Complex], Complex]

_POINTS = 8192
_SLOWEST = 1e-3


@dataclass(frozen=True)
class Margins:
    """How far a loop is from instability. The loop is cut at the output of its controller."""

    crossover: float
    """Frequency at which the open loop's gain falls through one [rad/s]."""
    phase_margin: float
    """Phase above -180 degrees at the crossover, the smallest if there are several [rad]."""
    gain_margin: float
    """Factor on the gain that makes the loop oscillate."""
    oscillation: float
    """Frequency at which it would oscillate then [rad/s]."""
    delay_margin: float
    """Additional delay in the loop that makes it oscillate [s]."""
    peak_sensitivity: float
    """Largest |1 / (1 + L)|: 1 over the distance from the critical point."""

    @property
    def phase_margin_deg(self) -> float:
        """The phase margin [deg]."""
        return math.degrees(self.phase_margin)

    @property
    def gain_margin_db(self) -> float:
        """The gain margin [dB]."""
        return 20.0 * math.log10(self.gain_margin)


def zero_order_hold(z: Complex, ticks: int) -> Complex:
    """Frequency response of holding a value for a number of ticks."""
    return np.asarray(sum(z**-i for i in range(ticks)) / ticks)


def integrated(z: Complex) -> Complex:
    """From a quantity to its integral as the estimator forms it, one tick later."""
    return np.asarray(TICK_S / (z - 1.0))


def driven_rate(z: Complex, time_constant: float, drive: YawDrive | None = None) -> Complex:
    """From acceleration asked for to velocity (angular or vertical) at the ticks, exact.

    gain (1 + lead s) / (s (time_constant s + 1)), behind one tick of transport and a hold.
    """
    gain, lead = (1.0, 0.0) if drive is None else (drive.gain, drive.lead)
    left = math.exp(-TICK_S / time_constant)
    lag = (lead - time_constant) * (1.0 - left) / (z - left)
    return np.asarray(gain / z * (TICK_S / (z - 1.0) + lag))


def rate_pid(z: Complex, c: ControlParams, yaw: bool) -> tuple[Complex, Complex]:
    """Responses of the rate controller to the set point and to the measured rate (times -1)."""
    p, i, d = (c.yaw_rate_p, c.yaw_rate_i, 0.0) if yaw else (c.rate_p, c.rate_i, c.rate_d)
    smooth = c.rate_cutoff * TICK_S / (1.0 + c.rate_cutoff * TICK_S)
    difference = smooth * (1.0 - 1.0 / z) / (1.0 - (1.0 - smooth) / z) / TICK_S
    forward = p + i * TICK_S * z / (z - 1.0)
    return forward, forward + d * difference


def velocity_pid_response(z: Complex, c: ControlParams) -> tuple[Complex, Complex]:
    """Responses of the velocity controller to the set point and to the velocity (times -1)."""
    period = POSITION_TICKS * TICK_S
    step = z**POSITION_TICKS
    forward = c.velocity_p + c.velocity_i * period / (step - 1.0)
    return forward, forward + c.velocity_d * (1.0 - 1.0 / step) / period


def open_loops(c: ControlParams, vehicle: VehicleParams, maps: RotorMaps) -> dict[str, Loop]:
    """Return the open loop of each controller, as a function of z on the unit circle.

    Args:
        c: gains.
        vehicle: motor lag, rotor inertia and weight.
        maps: the table `tombo_dynamics.rotor_maps` of its rotors.

    Returns:
        rate, attitude, velocity, position (roll and pitch, and the horizontal motion on them);
        yaw_rate, yaw; climb, height.
    """
    lag = vehicle.motor_time_constant
    drive = yaw_drive(vehicle, maps)

    def rate(z: Complex, yaw: bool = False) -> Complex:
        return rate_pid(z, c, yaw)[1] * driven_rate(z, lag, drive if yaw else None)

    def angle(z: Complex, yaw: bool = False) -> Complex:
        plant = driven_rate(z, lag, drive if yaw else None)
        inner = rate_pid(z, c, yaw)[0] * plant / (1.0 + rate(z, yaw))
        p = c.yaw_p if yaw else c.attitude_p
        return p * zero_order_hold(z, ATTITUDE_TICKS) * inner * integrated(z)

    def velocity(z: Complex) -> Complex:
        return velocity_pid_response(z, c)[1] * _horizontal(z)

    def _horizontal(z: Complex) -> Complex:
        tilted = angle(z) / (1.0 + angle(z))
        return zero_order_hold(z, POSITION_TICKS) * tilted * integrated(z)

    def climb(z: Complex) -> Complex:
        return velocity_pid_response(z, c)[1] * _vertical(z)

    def _vertical(z: Complex) -> Complex:
        return zero_order_hold(z, POSITION_TICKS) * driven_rate(z, lag)

    def position(z: Complex) -> Complex:
        inner = velocity_pid_response(z, c)[0] * _horizontal(z) / (1.0 + velocity(z))
        return c.position_p * inner * integrated(z)

    def height(z: Complex) -> Complex:
        inner = velocity_pid_response(z, c)[0] * _vertical(z) / (1.0 + climb(z))
        return c.position_p * inner * integrated(z)

    return {
        "rate": rate,
        "attitude": angle,
        "velocity": velocity,
        "position": position,
        "yaw_rate": lambda z: rate(z, yaw=True),
        "yaw": lambda z: angle(z, yaw=True),
        "climb": climb,
        "height": height,
    }


LOOP_TICKS = {
    "rate": RATE_TICKS,
    "yaw_rate": RATE_TICKS,
    "attitude": ATTITUDE_TICKS,
    "yaw": ATTITUDE_TICKS,
    "velocity": POSITION_TICKS,
    "climb": POSITION_TICKS,
    "position": POSITION_TICKS,
    "height": POSITION_TICKS,
}
"""Period of each loop in ticks; its response has a meaning up to half of its own frequency."""


def margins(loop: Loop, ticks: int = 1) -> Margins:
    """Return the margins of an open loop that is sampled every `ticks` ticks.

    Raises:
        ValueError: the loop's gain does not cross one, so there is nothing to measure.
    """
    fastest = math.pi / (ticks * TICK_S)
    w: Array = np.geomspace(_SLOWEST, fastest, _POINTS).astype(np.float64)[:-1]
    response = loop(np.exp(1j * w * TICK_S))
    gain: Array = np.log(np.abs(response))
    phase: Array = np.unwrap(np.angle(response)).astype(np.float64)
    phase -= 2.0 * math.pi * np.round((phase[0] + 0.75 * math.pi) / (2.0 * math.pi))
    falls = np.flatnonzero((gain[:-1] > 0.0) != (gain[1:] > 0.0))
    if not falls.size:
        raise ValueError("the open loop's gain does not cross one")
    crossings = [_between(w, gain, int(k), 0.0) for k in falls]
    leads = [math.pi + float(np.interp(x, w, phase)) for x in crossings]
    worst = int(np.argmin(leads))
    turns = np.flatnonzero((phase[:-1] > -math.pi) & (phase[1:] <= -math.pi))
    oscillation, room = math.inf, math.inf
    if turns.size:
        oscillation = _between(w, phase, int(turns[0]), -math.pi)
        room = math.exp(-float(np.interp(oscillation, w, gain)))
    return Margins(
        crossover=crossings[-1],
        phase_margin=leads[worst],
        gain_margin=room,
        oscillation=oscillation,
        delay_margin=min(lead / x for lead, x in zip(leads, crossings, strict=True)),
        peak_sensitivity=float(np.max(1.0 / np.abs(1.0 + response))),
    )


def _between(w: Array, curve: Array, k: int, level: float) -> float:
    share = (level - curve[k]) / (curve[k + 1] - curve[k])
    return float(w[k] * (w[k + 1] / w[k]) ** share)


def cascade_margins(
    c: ControlParams, vehicle: VehicleParams, maps: RotorMaps
) -> dict[str, Margins]:
    """Return the margins of all loops, see `open_loops`."""
    loops = open_loops(c, vehicle, maps)
    return {name: margins(loop, LOOP_TICKS[name]) for name, loop in loops.items()}
