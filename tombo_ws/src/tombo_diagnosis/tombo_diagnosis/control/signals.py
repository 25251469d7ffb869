"""Inputs and set points of a controller in one flight, on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Flight, Series
from tombo_diagnosis.rotor_demand import EXPONENT, MODES
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotor_maps import RotorMaps, rotor_thrust
from tombo_dynamics.vehicle import GRAVITY, VehicleParams
from tombo_logs.checks.even_flight import (
    EvenFlight,
    held_values,
    turns_at,
    unit_rows,
    usable_turns,
)
from tombo_logs.checks.ground import ground_spans
from tombo_logs.checks.samples import clean_series, nothing_left
from tombo_logs.checks.spans import Mask, inside, interpolated, sample_interval

_RATE: Final = (50.0, 1000.0)
"""Hz of the clock, least and most."""
_LONGEST: Final = 400_000
"""Rows of the clock: a longer flight has a slower one."""
_SHORTEST_S: Final = 2.0
_EDGE_S: Final = 1.0
"""Time after lift-off and before touch-down."""
_LIMIT: Final = 0.002
"""Share of the time at its highest or lowest value from which on a drive is at its limit."""


@dataclass(frozen=True)
class DrivePlant:
    """What turns commands of rotors into moments."""

    vehicle: VehicleParams
    maps: RotorMaps | None = None
    """None: thrust grows with the square of the speed."""
    torque_ratio: float = 0.0
    """Drag torque over thrust [m]; 0: not known."""


@dataclass(frozen=True)
class ControlSignals(EvenFlight):
    """Inputs and set points of a controller; None: not known.

    Rows are valid in the air, while drives are within their limits. The channel is gyro.
    """

    name: str
    rates_asked: Array | None
    turns: Rotation | None
    """N attitudes, map from base_link."""
    turns_asked: Rotation | None
    position: Array
    """(N, 3) m, map"""
    velocity: Array
    position_asked: Array | None
    velocity_asked: Array | None
    acceleration_asked: Array | None
    thrust_asked: Array | None
    """(N,) N"""
    moment: Array | None
    """(N, 3) what is asked for about body x, y, z, in `moment_unit`."""
    moment_unit: str


def control_signals(log: Flight, plant: DrivePlant | None) -> ControlSignals | None:
    """Lay what a controller saw and asked for on one clock; None: too little is there.

    Args:
        log: a flight as read.
        plant: turns rotor speeds into moments; None: moments are shares of hover's thrust.
    """
    measured, control = _cleaned(log, log.series), _cleaned(log, log.control)
    # set points, where the log has them
    drive = next((d for d in (*DRIVES[1:], DRIVES[0]) if d in measured), None)
    place = control.get("estimated_position") or measured.get("position")
    fastest = [
        measured.get("gyro"),
        control.get("torque_setpoint"),
        control.get("rates_setpoint"),
        place,
    ]
    intervals = [sample_interval(s.t) for s in fastest if s is not None and s.t.size > 20]
    if place is None or not intervals or min(intervals) <= 0.0:
        return None
    begin, end = place.t[0], place.t[-1]
    if not end - begin > _SHORTEST_S:
        return None
    rate = min(float(np.clip(1.0 / min(intervals), *_RATE)), _LONGEST / (end - begin))
    t = np.arange(begin, end, 1.0 / rate)
    ground = [] if "position" not in measured else ground_spans(measured["position"], measured)
    usable = ~inside(t, [(b - _EDGE_S, e + _EDGE_S) for b, e in ground])
    for name in ("attitude_setpoint", "rates_setpoint"):
        if name in control:
            usable &= (t > control[name].t[0] + _EDGE_S) & (t < control[name].t[-1])
    if not usable.any():
        return None
    moment, unit = None, ""
    if "torque_setpoint" in control:
        moment, unit = _hold_samples(control["torque_setpoint"], t), "N m"
    elif drive is not None:
        usable &= ~_at_limit(measured[drive], t)
        moment, unit = _moment(measured[drive], drive, t, usable, plant, log)
    seen = control.get("estimated_attitude") or measured.get("attitude")
    turns = None if seen is None else turns_at(seen, t)
    position = interpolated(t, place.t, place.values)
    gyro = measured.get("gyro")
    # of a loop that is computed elsewhere a set point holds since it came in
    asked = {name: _hold_samples(series, t, arrived=True) for name, series in control.items()}
    attitude, thrust = asked.get("attitude_setpoint"), control.get("thrust_setpoint")
    rates = control.get("rates_setpoint")
    return ControlSignals(
        t,
        {} if gyro is None else {"gyro": interpolated(t, gyro.t, gyro.values)},
        usable,
        log.name,
        None if rates is None else _hold_samples(rates, t),
        turns,
        None if attitude is None else Rotation.from_quat(unit_rows(attitude)),
        position,
        _velocity(control, turns, position, t),
        asked.get("position_setpoint"),
        asked.get("velocity_setpoint"),
        asked.get("acceleration_setpoint"),
        None if thrust is None else _hold_samples(thrust, t)[:, 0],
        moment,
        unit,
    )


def _velocity(
    control: Mapping[str, Series], turns: Rotation | None, position: Array, t: Array
) -> Array:
    """Return the velocity (N, 3) in map: as estimated, or of the positions."""
    if "estimated_velocity" in control:
        series = control["estimated_velocity"]
        return interpolated(t, series.t, series.values)
    if "estimated_body_velocity" in control and turns is not None:
        series = control["estimated_body_velocity"]
        return np.asarray(turns.apply(interpolated(t, series.t, series.values)))
    return np.asarray(np.gradient(position, t, axis=0))


def _cleaned(log: Flight, series: Mapping[str, Series]) -> dict[str, Series]:
    return {n: s for n, raw in series.items() if not nothing_left(s := _clean(log, n, raw))}


def _clean(log: Flight, name: str, raw: Series) -> Series:
    if not raw.t.size:
        return raw
    wide = Series(raw.t, raw.values.reshape(len(raw.t), -1), raw.arrival)
    cleaned = clean_series(log.name, name, wide)[0]
    if cleaned.t.size and cleaned.values.shape[1] == 4 and "attitude" in name:
        return usable_turns(cleaned)
    return cleaned


def _hold_samples(series: Series, t: Array, arrived: bool = False) -> Array:
    """Return what holds at each time; `arrived`: since it came in, where that is known."""
    known = series.arrival if arrived and series.arrival is not None else series.t
    return held_values(t + 1e-6, known, series.values)


def _at_limit(drive: Series, t: Array) -> Mask:
    top, bottom = drive.values.max(axis=0), drive.values.min(axis=0)
    span = np.maximum(top - bottom, 1e-9)
    out = np.zeros(t.size, np.bool_)
    values = _hold_samples(drive, t)
    for edge in (top, bottom):
        near = np.abs(values - edge) < 1e-4 * span
        out |= (near & (near.mean(axis=0) > _LIMIT)).any(axis=1)
    return out


def _moment(
    drive: Series, name: str, t: Array, usable: Mask, plant: DrivePlant | None, log: Flight
) -> tuple[Array | None, str]:
    values = np.maximum(_hold_samples(drive, t), 0.0)
    frame = log.airframe
    if plant is not None and plant.maps is not None and name != "motor_command":
        grid = np.linspace(0.0, float(values.max()), 400)
        thrust = np.interp(values, grid, [rotor_thrust(plant.maps, x) for x in grid.tolist()])
        share = 4.0 * thrust / (plant.vehicle.mass * GRAVITY)
    else:
        thrust = values ** EXPONENT[name][0]
        if not usable.any() or not np.median(thrust[usable]) > 0.0:
            return None, ""
        share = thrust / np.mean(thrust[usable])
    modes = share @ (MODES[1:] * [[1.0], [1.0], [-1.0]]).T  # drag turns against the rotor
    if frame is not None and frame.inertia is not None:
        scale = frame.mass * GRAVITY * frame.arm_length / np.sqrt(2.0) / np.array(frame.inertia)
        return np.asarray(modes * [scale[0], scale[1], np.nan]), "rad/s^2"
    if plant is not None:
        v = plant.vehicle
        lever = np.array([v.arm_length / np.sqrt(2.0)] * 2 + [plant.torque_ratio])
        inertia = np.array([v.inertia_xx, v.inertia_yy, v.inertia_zz])
        return np.asarray(modes * v.mass * GRAVITY * lever / inertia), "rad/s^2"
    return np.asarray(modes), "1"
