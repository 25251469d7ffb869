"""Thrust that the rotors give over the thrust asked for; commands of rotors from set points."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Airframe, Flight, Series
from tombo_diagnosis.control.gains import LoopFit, LoopGain
from tombo_diagnosis.control.signals import ControlSignals
from tombo_diagnosis.rotor_demand import HOVER_SPEED
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ARM_X, ARM_Y, GRAVITY, SPIN
from tombo_logs.checks.spans import block_means

ACTUATORS: Final = "actuators"
"""The loop's name in `thrust_gain`."""
AS_ASKED: Final = LoopGain(ACTUATORS, "z", "gain", "1", 1.0, 1.0, 1.0)
"""Gain of rotors that give the thrust asked for."""
_BLOCK_S, _FEWEST = 1.0, 4
"""Length [s] and least number of the blocks whose scatter gives the interval."""
_STRUCTURE: Final = 0.04
"""Relative standard error of values that no log has: a scale's, a barometer's, a falling
supply's."""
_T975: Final = 3.2
"""Of Student's distribution with `_FEWEST` - 1 degrees of freedom."""
_DRAG_ARM: Final = 0.2
"""Drag torque over thrust, in radii of the rotor: of small propellers; it scales yaw alone."""


def thrust_gain(flight: Flight, signals: ControlSignals) -> LoopFit | None:
    """Return thrust that the rotors give over the thrust that is asked for; None: not known.

    Args:
        flight: with an airframe, whose mass counts, and a thrust set point [N].
        signals: what its controller saw and asked for.
    """
    frame, asked = flight.airframe, signals.thrust_asked
    if frame is None or asked is None or signals.turns is None:
        return None
    block = max(round(_BLOCK_S / signals.step), 1)
    whole = block_means(signals.valid.astype(np.float64), block) > 0.99
    given = frame.mass * block_means(_specific_force(flight, signals), block)[whole]
    wanted = block_means(asked, block)[whole]
    if given.size < _FEWEST or not (wanted > 0.0).all():
        return None
    ratio = given / wanted
    value = float(np.median(ratio))
    half = _T975 * float(ratio.std(ddof=1)) / np.sqrt(ratio.size) + 2.0 * _STRUCTURE * value
    return LoopFit(
        ACTUATORS, "z", (replace(AS_ASKED, value=value, low=value - half, high=value + half),), 1.0
    )


def _specific_force(flight: Flight, signals: ControlSignals) -> Array:
    """Return the specific force along body z [m/s^2] (N,), measured or from the velocity."""
    accel = flight.series.get("accel")
    if accel is not None and accel.t.size:
        return np.asarray(np.interp(signals.t, accel.t, accel.values[:, 2]))
    assert signals.turns is not None  # the caller has seen to it
    up = signals.turns.apply([0.0, 0.0, 1.0])
    force = np.gradient(signals.velocity, signals.step, axis=0)
    force[:, 2] += GRAVITY
    return np.asarray(np.einsum("ni,ni->n", force, up))


def with_asked_rotors(flight: Flight) -> Flight:
    """Return a flight with commanded rotor speeds (N, 4) [rad/s], computed from its set points.

    `_mixer` turns collective thrust [N] and torque [N m], base_link, into rotor thrusts. These go
    with the square of speed; hover is `HOVER_SPEED` by definition, as only ratios are used.
    Samples in which a rotor would push down, or that have NaN, are left out.

    The flight itself is returned if it has commands or speeds of rotors. It is also returned if
    its airframe or one of the set points is not known, or no sample is left.
    """
    control, frame = flight.control, flight.airframe
    needed = ("thrust_setpoint", "torque_setpoint")
    if frame is None or set(DRIVES) & set(flight.series) or not set(needed) <= set(control):
        return flight
    thrust, torque = (control[name] for name in needed)
    collective = thrust.values.reshape(thrust.t.size, -1)[:, 0]
    t = torque.t
    setpoint = np.column_stack([np.interp(t, thrust.t, collective), torque.values])
    hover_thrust = frame.mass * GRAVITY / 4.0
    ratio = setpoint @ _mixer(frame).T / hover_thrust
    keep = np.isfinite(ratio).all(axis=1) & (ratio > 0.0).all(axis=1)
    if not keep.any():
        return flight
    speed = Series(t[keep], HOVER_SPEED * np.sqrt(ratio[keep]))
    return flight.with_series({**flight.series, "rotor_command": speed})


def _mixer(frame: Airframe) -> Array:
    """Return (4, 4), which makes rotor thrusts [N] of collective thrust [N] and torque [N m].

    Torque about body x, y, z; rotors in the order of ROTOR_NAMES.
    """
    arm, drag = frame.arm_length, _DRAG_ARM * frame.rotor_radius
    effect = [np.ones(4), arm * ARM_Y, -arm * ARM_X, -drag * SPIN]
    return np.asarray(np.linalg.inv(np.array(effect)))
