"""A vehicle file from healthy flights: thrust, motor lag, inertia and drag, with intervals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from tombo_diagnosis.engine.cause_estimates import TWO_SIDED, fitted_parameter
from tombo_diagnosis.engine.evidence import solve
from tombo_diagnosis.engine.regression import NOMINAL_WIDTHS, Fit
from tombo_diagnosis.flight.analyse import select_noise_fits
from tombo_diagnosis.flight.calibrate import mean_of, specific_force
from tombo_diagnosis.flight.fit.problem import FlightProblem, tangent_of
from tombo_diagnosis.flight.fit.track import FAST_SPACING, SLOW_SPACING, track_of
from tombo_diagnosis.flight.noise.noise_statistics import fit_noise_effects
from tombo_diagnosis.flight.residual_check import residual_variances
from tombo_diagnosis.flight.scenario_nominal import held_against, nominal_model
from tombo_dynamics.arrays import Array
from tombo_dynamics.drive import DriveParams
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import from_mapping
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.extended_model import FittedParameter
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.vehicle_file import HealthyFlights, Note, VehicleFile
from tombo_logs.checks.spans import block_means
from tombo_logs.flight_log import FlightLog

FITTED = {
    "thrust_coefficient_error.fraction": "thrust of the propellers",
    "motor_lag.extra_tau": "motor time constant",
    "inertia_error.xx": "moment of inertia about x",
    "inertia_error.yy": "moment of inertia about y",
    "inertia_error.zz": "moment of inertia about z",
    "linear_rotor_drag.d_xy": "drag per speed in the disc plane",
    "linear_rotor_drag.d_z": "drag per speed along the rotor axis",
    "flapping_moment.k": "moment per speed in the disc plane",
    "translational_lift.k": "thrust per square of the speed across",
    "cog_offset.x": "centre of gravity ahead of the centre",
    "cog_offset.y": "centre of gravity left of the centre",
    "imu_lever_arm.x": "IMU ahead of the centre",
    "imu_lever_arm.y": "IMU left of the centre",
    "mocap_stamp_error.offset": "error of the poses' stamps",
    "mocap_body_misalignment.roll": "roll of the rigid body as it was defined",
    "mocap_body_misalignment.pitch": "pitch of the rigid body as it was defined",
}
"""Parameters that flights are fitted for, and what they tell: what stays from day to day."""
_SEEN = 0.3
"""A parameter is seen if its standard deviation is below this share of the size that matters."""
_BLOCK_S = 0.25
_FEWEST_BLOCKS = 8
_LEAST_SPREAD = 0.02
"""Share of its mean by which a command has to vary before gain and offset can be told apart."""
_LEAST_SUPPLY_SPREAD = 0.005


@dataclass(frozen=True)
class VehicleFit:
    """A vehicle as its flights show it."""

    file: VehicleFile
    seen: Mapping[str, FittedParameter]
    """What was fitted -> the value with its 95 % interval, as a change of the base."""
    unseen: tuple[str, ...]
    """What these flights could not show, and so is as in the base."""


def fit_vehicle(
    logs: Sequence[FlightLog], base: VehicleFile, progress: ProgressCallback = no_progress
) -> VehicleFit:
    """Fit a vehicle to healthy flights; mass and geometry are those of the base.

    Where logs have rotor speeds, the thrust of the propellers is fitted; where they have motor
    commands from 0 to 1, the drive that makes thrust of them.

    Args:
        logs: flights, checked.
        base: what is known before; what the flights don't show stays.
        progress: called with a stage and the share done.

    Raises:
        InputError: no flight that can be used, or neither commands nor speeds.
    """
    progress("fitting thrust", 0.0)
    file = base
    if not all(log.has_rotor_speeds for log in logs):
        file = _with_fitted_drive(logs, base)
    file = _with_supply(logs, file)
    progress("fitting lag, inertia and drag", 0.3)
    held = held_against(logs, file)
    problem = FlightProblem([track_of(log) for log in held], nominal_model(vehicle=file))
    own = {p.label: p for p in problem.nominal.parameters if p.label in FITTED}
    if file.drive.known:
        own.pop("thrust_coefficient_error.fraction")  # the drive has taken it up
    free = [p.index for p in own.values() if p.index in problem.columns.identifiable]
    fit = problem.fit(free, NOMINAL_WIDTHS, problem.null_hypothesis)
    seen: dict[str, FittedParameter] = {}
    for label, p in own.items():
        if p.index not in free:
            continue
        (place,) = problem.columns.places([p.index])
        deviation = math.sqrt(max(float(fit.solution.covariance[place, place]), 0.0))
        value = float(fit.theta[p.index])
        inside = p.low + deviation < value < p.high - deviation or value == p.null
        if deviation < _SEEN * p.scale and inside:
            nominal = float(problem.theta[p.index])
            seen[label] = fitted_parameter(p, nominal, value, deviation)
    left = residual_variances(problem, fit)
    residuals = {
        name: tuple(float(v) for v in np.nan_to_num(left.variances[:, j]))
        for j, name in enumerate(left.names)
    }
    healthy = HealthyFlights(len(logs), residuals, _spread(problem, fit))
    file = dataclasses.replace(file, healthy=healthy, effects=_with_noise(problem, fit, file))
    count = len(logs)
    unseen = tuple(text for label, text in FITTED.items() if label in own and label not in seen)
    return VehicleFit(_with_fitted(file, seen, count), seen, unseen)


def _spread(problem: FlightProblem, fit: Fit) -> dict[str, float]:
    """Return effect.parameter -> how far it is from the fit in single flights, as one deviation.

    Of few flights a deviation is known badly: Student's factor makes it as wide as one that is
    known well.
    """
    columns, count = problem.columns, len(problem.tracks)
    if count < 2:
        return {}
    factor = float(stats.t.ppf(0.975, count)) / TWO_SIDED * math.sqrt(1.0 + 1.0 / count)
    normals = tangent_of(fit).normals
    found = {}
    for index in columns.identifiable:
        p, (place,) = columns.parameters[index], columns.places([index])
        deviations = columns.deviations((index,), fit.widths, pinned=fit.pinned)
        alone = [solve(normal, deviations, covariance=False).mean[place] for normal in normals]
        found[p.label] = factor * float(np.sqrt(np.mean(np.square(alone))))
    return found


def _with_supply(logs: Sequence[FlightLog], file: VehicleFile) -> VehicleFile:
    """Return a vehicle with the highest voltage that its flights begin with."""
    volts = [log.series["voltage"].values[:, 0] for log in logs if "voltage" in log.series]
    full = max((float(np.nanmax(v[: max(1, v.size // 20)])) for v in volts), default=math.nan)
    if not math.isfinite(full):
        return file
    vehicle = from_mapping(
        VehicleParams, {**dataclasses.asdict(file.vehicle), "battery_voltage": full}, "vehicle"
    )
    notes = {**file.notes, "vehicle.battery_voltage": Note(None, "highest in these flights")}
    given = file.given | {"vehicle.battery_voltage"}
    return dataclasses.replace(file, vehicle=vehicle, notes=notes, given=given)


def _with_noise(
    problem: FlightProblem, fit: Fit, file: VehicleFile
) -> dict[str, dict[str, float]]:
    """Return a vehicle's effects with the noise that its flights show, where it is another."""
    effects = {name: dict(values) for name, values in file.effects.items()}
    parameters = problem.nominal.parameters
    for found in select_noise_fits(fit_noise_effects(problem.tracks, problem.nominal, fit.theta)):
        for index, value in zip(found.free, found.value, strict=True):
            effects.setdefault(found.effect, {})[parameters[index].name] = float(value)
    return effects


def _with_fitted_drive(logs: Sequence[FlightLog], base: VehicleFile) -> VehicleFile:
    """Return the base with a drive: thrust by command and supply."""
    drive, error = fit_drive(logs, base.vehicle.mass)
    source = f"fitted to {len(logs)} flights"
    notes = {f"drive.{name}": Note(None, source) for name in ("offset", "supply_exponent")}
    notes["drive.gain"] = Note(max(error * drive.gain, 1e-9), source)
    fields = [f"drive.{f.name}" for f in dataclasses.fields(drive)]
    return dataclasses.replace(
        base, drive=drive, given=base.given | {*fields}, notes={**base.notes, **notes}
    )


def fit_drive(logs: Sequence[FlightLog], mass: float) -> tuple[DriveParams, float]:
    """Return the drive that healthy flights show, and the relative error of its thrust.

    Least squares of the specific force along the thrust axis on the mean command and the
    supply, in blocks of a quarter of a second; the error is that of the flights among each
    other.

    Args:
        logs: flights with motor_command, and voltage if it is measured.
        mass: [kg], all rotors together carry it.

    Raises:
        InputError: a log without motor commands.
    """
    samples = [_drive_samples(log) for log in logs]
    supply = float(np.nanmean(np.concatenate([s[:, 1] for s in samples])))
    known = math.isfinite(supply)
    every = np.vstack(samples)
    varies = float(every[:, 0].std()) > _LEAST_SPREAD * float(every[:, 0].mean())
    drains = known and float(every[:, 1].std()) > _LEAST_SUPPLY_SPREAD * supply

    def predicted(x: Array, rows: Array) -> Array:
        supplied = (rows[:, 1] / supply) ** x[2] if drains else 1.0
        return np.asarray((x[1] * varies + x[0] * rows[:, 0]) * supplied)

    def solved(rows: Array) -> Array:
        start = [float(rows[:, 2].mean() / rows[:, 0].mean()), 0.0, 0.0]
        found = least_squares(lambda x: predicted(x, rows) - rows[:, 2], start, loss="soft_l1")
        return np.asarray(found.x)

    x = solved(every)
    ratio = [float(np.mean(s[:, 2]) / np.mean(predicted(x, s))) for s in samples]
    error = float(np.std(ratio, ddof=1)) / math.sqrt(len(ratio)) if len(ratio) > 1 else 0.02
    share = mass / 4.0
    return DriveParams(
        gain=share * float(x[0]),
        offset=share * float(x[1]) * varies,
        supply_exponent=float(np.clip(x[2], -4.0, 4.0)) if drains else 0.0,
        supply=supply if known else 1.0,
    ), max(error, 1e-3)


def _drive_samples(log: FlightLog) -> Array:
    """Return (N, 3) mean command, supply [V] or NaN, specific force along the thrust [m/s^2]."""
    command = log.series.get("motor_command")
    if command is None:
        raise InputError(
            f"flight '{log.name}': neither rotor speeds nor motor commands; accepted: a log with "
            "motor_command, rotor_command or rotor_speed"
        )
    track = track_of(log)
    mean, force = mean_of(command, track.t), specific_force(track)
    volts = track.voltage[:, 0] if track.voltage.size else np.full(track.t.size, np.nan)
    kernel, spacing = (
        (track.fast_kernel, FAST_SPACING)
        if track.accel.size
        else (track.slow_kernel, SLOW_SPACING)
    )
    rows = kernel.smooth @ np.column_stack([mean, volts, force])
    blocks = block_means(rows, max(1, round(_BLOCK_S / spacing)))
    if len(blocks) < _FEWEST_BLOCKS:
        raise InputError(
            f"flight '{log.name}': {len(blocks) * _BLOCK_S:g} s in the air; accepted: "
            f"{_FEWEST_BLOCKS * _BLOCK_S:g} s or more"
        )
    return blocks


def _with_fitted(
    file: VehicleFile, seen: Mapping[str, FittedParameter], flights: int
) -> VehicleFile:
    """Return a vehicle with the values that were seen."""
    vehicle, propeller = file.vehicle, file.propeller
    notes, given = dict(file.notes), set(file.given)
    effects = {name: dict(values) for name, values in file.effects.items()}
    source = f"fitted to {flights} flights"

    def noted(key: str, tolerance: float) -> None:
        notes[key] = Note(max(tolerance, 1e-12), source)
        given.add(key)

    for label, found in seen.items():
        effect, _, name = label.partition(".")
        deviation = (found.high - found.low) / (2.0 * TWO_SIDED)
        if effect == "inertia_error":
            old = getattr(vehicle, f"inertia_{name}")
            new = old * (1.0 + found.value)
            vehicle = dataclasses.replace(vehicle, **{f"inertia_{name}": new})
            noted(f"vehicle.inertia_{name}", old * deviation)
        elif effect == "motor_lag":
            new = max(vehicle.motor_time_constant + found.value, 1e-3)
            vehicle = dataclasses.replace(vehicle, motor_time_constant=new)
            noted("vehicle.motor_time_constant", deviation)
        elif effect == "thrust_coefficient_error" and propeller.k_thrust > 0.0:
            old = propeller.k_thrust
            propeller = dataclasses.replace(propeller, k_thrust=old * (1.0 + found.value))
            noted("propeller.k_thrust", old * deviation)
        else:
            effects.setdefault(effect, {})[name] = found.value
    return dataclasses.replace(
        file, vehicle=vehicle, propeller=propeller, effects=effects, notes=notes,
        given=frozenset(given), about=file.about or f"fitted to {flights} flights",
    )  # fmt: skip
