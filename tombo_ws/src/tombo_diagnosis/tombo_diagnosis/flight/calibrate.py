"""A nominal model for a vehicle that the suite does not know: thrust from its own flights.

Of such a vehicle mass, arms and motor commands are known at best. Thrust is fitted to the very
flights: its coefficient where rotor speeds are known, else a gain and an offset from command to
thrust. Errors of mass, thrust and level can't be seen then; drag, wind, delays and faults of the
motion capture can.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.channels import DRIVES, ROTOR_SPEEDS
from tombo_bag.flight import Airframe, Flight, Series, why_left_out
from tombo_diagnosis.flight.fit.track import Track, track_of
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_diagnosis.rotor_demand import HOVER_SPEED
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.mounted_propeller import PlainPropeller
from tombo_dynamics.rotor_maps import rotor_maps, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY, ROTOR_NAMES, VehicleParams
from tombo_logs.checks.even_flight import poses_and_imu
from tombo_logs.checks.spans import interpolated
from tombo_logs.checks.wind import DRAG_KNOWN, USUAL_DRAG, Push, push_of
from tombo_logs.readers.vehicle_airframe import vehicle_of

_SLOWEST, _FASTEST = 0.1, 2.5
"""Speeds of the rotors over that in hover."""
_TORQUE_M = 0.01
"""Drag torque over thrust [m]; moments are not compared."""
_FEWEST = 10
"""Samples of a channel that is used."""
_FACTORS = {"mass_error.fraction", "thrust_coefficient_error.fraction"}
_ABSORBED_PARAMETERS = frozenset(
    {
        *_FACTORS,
        *(f"imu_bias.{c}_{a}" for c in ("accel", "gyro") for a in "xyz"),
        *(f"accel_scale.{a}" for a in "xyz"),
        *(f"mocap_body_misalignment.{a}" for a in ("yaw", "roll", "pitch")),
        *(f"mocap_misalignment.{a}" for a in ("yaw", "roll", "pitch")),
        *(f"imu_misalignment.{a}" for a in ("yaw", "roll", "pitch")),
        *("battery_sag.resistance", "battery_sag.discharge"),
    }
)
_TIMING = frozenset({"mocap_stamp_error.offset", "motor_lag.extra_tau", "command_delay.delay"})
"""Only a gyro tells late stamps from thrust that comes late in a way that is not known."""
_THRUST_PARAMETERS = frozenset(
    {
        *(*_FACTORS, "ground_effect.strength", "translational_lift.k", "linear_rotor_drag.d_z"),
        *(f"weak_propeller.{rotor}" for rotor in ROTOR_NAMES),
    }
)
"""What only changes thrust: unknown where thrust is taken from the track."""


def calibrated(logs: Sequence[Flight]) -> tuple[NominalModel, list[Flight]]:
    """Return a nominal model of the logs' airframe, and the logs with commands as rotor speeds.

    Raises:
        InputError: airframes differ, or no motor commands or rotor speeds.
    """
    frame = logs[0].airframe
    if frame is None or any(log.airframe != frame for log in logs):
        other = next((log.name for log in logs if log.airframe != frame), logs[0].name)
        raise InputError(
            f"flight '{other}': another vehicle than '{logs[0].name}'; accepted: flights of one "
            "vehicle"
        )
    if all(_speed_channels(log) for log in logs):
        hover, changed = speed_in_hover(logs), [_with_asked_speeds(log) for log in logs]
    else:
        offset, gain = _thrust_fit(logs)
        hover, changed = HOVER_SPEED, [_with_speeds(log, offset, gain) for log in logs]
    vehicle = _vehicle(frame, hover)
    coefficient = frame.mass * GRAVITY / 4.0 / hover**2
    maps = rotor_maps(PlainPropeller(coefficient, _TORQUE_M * coefficient), vehicle)
    label = f"{frame.name}, thrust fitted to its own flights"
    absorbed = _ABSORBED_PARAMETERS
    if not any("gyro" in log.series for log in logs):
        absorbed |= _TIMING
    drag = frame.mass * _drag_in_wind(logs)
    effects = {"linear_rotor_drag": {"d_xy": drag}} if drag > 0.0 else {}
    return NominalModel(label, vehicle, maps, effects, True, absorbed, False), changed


def _drag_in_wind(logs: Sequence[Flight]) -> float:
    """Return the drag per mass [1/s] by which wind acts in these flights; 0: wind is 0.

    Wind is a force by the drag alone: without a drag no speed of the air would be a cause. It is
    that of the flights where they show it, else the usual one.
    """
    windy = windy_flights(logs)
    if 2 * len(windy) <= len(logs):
        return 0.0
    drag, deviation = drag_shown([push for log in windy if (push := push_in(log)) is not None])
    return drag if deviation < DRAG_KNOWN * drag else USUAL_DRAG


def windy_flights(logs: Sequence[Flight]) -> list[Flight]:
    """Return the flights in which the checks have seen wind."""
    return [log for log in logs if any(f.check == "wind" for f in log.findings)]


def drag_shown(pushes: Sequence[Push]) -> tuple[float, float]:
    """Return the drag per mass [1/s] that flights show together, and its standard deviation."""
    weights = [push.drag_deviation**-2.0 for push in pushes]
    drag = sum(w * p.drag for w, p in zip(weights, pushes, strict=True)) / max(sum(weights), 1e-9)
    return drag, sum(weights) ** -0.5 if weights else math.inf


def push_in(log: Flight) -> Push | None:
    """Return the force that a flight's own motion does not make; None: it is too short."""
    series = log.series
    if "attitude" not in series:
        return None
    gyro, accel = series.get("gyro"), series.get("accel")
    motion = poses_and_imu(series["position"], series["attitude"], gyro, accel, list(log.exclude))
    return push_of(motion, series["position"])


def has_no_thrust_data(log: Flight) -> bool:
    """Return whether a log has nothing that tells thrust: no IMU, no rotors."""
    return not {"accel", *DRIVES} & set(log.series)


def thrust_from_track(
    logs: Sequence[Flight], nominal: NominalModel
) -> tuple[NominalModel, list[Flight]]:
    """Return the model and the logs with the thrust that the poses themselves call for.

    With poses alone the force along the thrust can't be told from thrust; those across it can.
    """
    changed = []
    for log in logs:
        track = track_of(log)
        thrust = 0.25 * nominal.vehicle.mass * np.maximum(force_along_thrust(track), 0.0)
        speed = np.array([speed_for_thrust(nominal.maps, t) for t in thrust])
        series = Series(track.t, np.repeat(speed[:, None], 4, axis=1))
        changed.append(log.with_series({**log.series, "rotor_speed": series}))
    label = f"{nominal.label}, thrust from the track"
    fitted = nominal.fitted | _THRUST_PARAMETERS
    return replace(nominal, label=label, moments=False, fitted=fitted), changed


def _speed_channels(log: Flight) -> list[str]:
    """Return the channels with rotor speeds, measured ones first."""
    return [n for n in ROTOR_SPEEDS if n in log.series and log.series[n].t.size >= _FEWEST]


def speed_in_hover(logs: Sequence[Flight]) -> float:
    """Return the rotor speed that carries the weight [rad/s]: thrust grows with its square.

    `logs`: flights with rotor speeds.
    """
    speeds = [log.series[_speed_channels(log)[0]] for log in logs]
    square, force = _drive_and_force(logs, [replace(s, values=s.values**2) for s in speeds])
    return float(np.sqrt(GRAVITY * (square @ square) / (square @ force)))


def _drive_and_force(logs: Sequence[Flight], drives: Sequence[Series]) -> tuple[Array, Array]:
    """Return mean drive and specific force along body z [m/s^2] of all flights, smoothed alike."""
    xs, ys = [], []
    for log, drive in zip(logs, drives, strict=True):
        track = track_of(log)
        smooth = track.slow_kernel.smooth
        xs.append(smooth @ mean_of(drive, track.t))
        ys.append(smooth @ specific_force(track))
    return np.concatenate(xs), np.concatenate(ys)


def _with_asked_speeds(log: Flight) -> Flight:
    """Return a log whose motor commands, where there are any, are speeds that they ask for.

    One line for all rotors from command to measured speed: the difference of a rotor stays
    visible.
    """
    command = log.series.get("motor_command")
    if "rotor_command" in log.series or "rotor_speed" not in log.series or command is None:
        return log
    speed = log.series["rotor_speed"]
    good = np.isfinite(speed.values).all(axis=1)
    asked = interpolated(command.t, speed.t[good], speed.values[good])
    finite = np.isfinite(command.values).all(axis=1)
    x = command.values[finite].ravel()
    slope, offset = np.polyfit(x, asked[finite].ravel(), 1) if np.ptp(x) > 0.0 else (0.0, 0.0)
    if slope <= 0.0:
        return log
    values = np.maximum(offset + slope * command.values, 0.0)
    return log.with_series({**log.series, "rotor_command": replace(command, values=values)})


def mean_of(series: Series, t: Array) -> Array:
    """Return the mean over the rotors at times t, (N,)."""
    good = np.isfinite(series.values).all(axis=1)
    return np.asarray(np.interp(t, series.t[good], series.values[good].mean(axis=1)))


def specific_force(track: Track) -> Array:
    """Return the specific force along body z [m/s^2], (N,): measured, or of the poses."""
    return track.accel[:, 2] if track.accel.size else force_along_thrust(track)


def _vehicle(frame: Airframe, hover: float) -> VehicleParams:
    """Return the airframe as a vehicle that hovers at this rotor speed [rad/s]."""
    return replace(
        vehicle_of(frame).vehicle,
        rotor_height=0.0,
        rotor_inertia=1e-9,
        rotor_speed_min=_SLOWEST * hover,
        rotor_speed_max=_FASTEST * hover,
    )


def _drive(log: Flight) -> Series:
    """Return what drives the rotors, with values that thrust is linear in."""
    for name in ("motor_command", "rotor_speed", "rotor_command"):
        series = log.series.get(name)
        if series is not None and series.t.size >= _FEWEST:
            return series if name == "motor_command" else replace(series, values=series.values**2)
    raise InputError(
        f"flight '{log.name}': no motor commands{why_left_out(log.findings, DRIVES)}; accepted: a "
        "log with motor_command, rotor_command or rotor_speed"
    )


def _thrust_fit(logs: Sequence[Flight]) -> tuple[float, float]:
    """Return offset and gain from the mean drive to specific force along body z [m/s^2]."""
    x, y = _drive_and_force(logs, [_drive(log) for log in logs])
    spread = float(x.std())
    gain = float(np.mean((x - x.mean()) * (y - y.mean()))) / max(spread**2, 1e-12)
    if spread < 1e-3 * abs(float(x.mean())) or gain * float(x.mean()) < 0.1 * GRAVITY:
        # Too little changes to fit two numbers: thrust in proportion to the drive.
        return 0.0, float(y.mean() / x.mean())
    return float(y.mean() - gain * x.mean()), gain


def force_along_thrust(track: Track) -> Array:
    """Return specific force along body z from the motion capture alone [m/s^2], (N,)."""
    pose = interpolated(track.t, track.pose_t, track.pose)
    up = pose[:, 3:] / np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    rows = track.slow.curvature @ pose[:, :3] + np.array([0.0, 0.0, GRAVITY])
    force = interpolated(track.t, track.slow.t, rows)
    return np.asarray(np.einsum("nji,nj->ni", Rotation.from_quat(up).as_matrix(), force)[:, 2])


def _with_speeds(log: Flight, offset: float, gain: float) -> Flight:
    drive = _drive(log)
    share = np.maximum((offset + gain * drive.values) / GRAVITY, 1e-3)
    speed = Series(drive.t, HOVER_SPEED * np.sqrt(share), drive.arrival)
    series = {k: v for k, v in log.series.items() if k not in ROTOR_SPEEDS}
    return log.with_series({**series, "rotor_command": speed})
