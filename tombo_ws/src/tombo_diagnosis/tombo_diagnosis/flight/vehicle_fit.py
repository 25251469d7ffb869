"""A vehicle file from healthy flights: thrust, motor lag, inertia and drag, with intervals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from tombo_bag.flight import Flight
from tombo_diagnosis.engine.cause_estimates import TWO_SIDED, fitted_parameter
from tombo_diagnosis.engine.regression import NOMINAL_WIDTHS, Fit, FreeParameter, solve
from tombo_diagnosis.flight.analyse import select_noise_fits
from tombo_diagnosis.flight.calibrate import mean_of, specific_force
from tombo_diagnosis.flight.diagnose import diagnose_flights
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.sensitivity import scatter_unit
from tombo_diagnosis.flight.fit.track import FAST_SPACING, SLOW_SPACING, track_of
from tombo_diagnosis.flight.noise import fit_noise_effects
from tombo_diagnosis.flight.nominal import SCATTER_LABEL, held_against, nominal_model
from tombo_diagnosis.flight.residual_check import ScaleVariances, residual_variances
from tombo_diagnosis.rotor_demand import SESSION_SCATTER
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import from_mapping
from tombo_dynamics.vehicle import DriveParams, VehicleParams
from tombo_flight.extended_model import FittedParameter
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.vehicle_file import EFFECT_OF, HealthyFlights, Note, VehicleFile
from tombo_logs.checks.spans import block_means

FITTED = {
    "thrust_coefficient_error.fraction": "thrust of the propellers",
    "motor_lag.extra_tau": "motor time constant",
    "command_delay.delay": "delay of the commands",
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
    "imu_lever_arm.z": "IMU above the centre",
    "imu_misalignment.roll": "roll of the IMU as it is mounted",
    "imu_misalignment.pitch": "pitch of the IMU as it is mounted",
    "imu_misalignment.yaw": "yaw of the IMU as it is mounted",
    "mocap_marker_offset.x": "markers ahead of the centre",
    "mocap_marker_offset.y": "markers left of the centre",
    "mocap_marker_offset.z": "markers above the centre",
    "mocap_stamp_error.offset": "error of the poses' stamps",
    "mocap_body_misalignment.yaw": "yaw of the rigid body as it was defined",
    "mocap_body_misalignment.roll": "roll of the rigid body as it was defined",
    "mocap_body_misalignment.pitch": "pitch of the rigid body as it was defined",
}
"""Parameters that are fitted to flights, with their meaning: what stays from day to day."""
_MAX_RELATIVE_DEVIATION = 0.3
"""A parameter is seen if its standard deviation is below this share of the size that matters."""
_MOST_FITS = 6
"""Fits without some of the flights, at most; of more flights several are left out together."""
_EM_STEPS = 30
_BLOCK_S = 0.25
_FEWEST_BLOCKS = 8
_LEAST_SPREAD = 0.02
"""Share of its mean by which a command has to vary before gain and offset can be told apart."""
_LEAST_SUPPLY_SPREAD = 0.005


@dataclass(frozen=True)
class VehicleFit:
    """A vehicle as its flights show it."""

    file: VehicleFile
    fitted: Mapping[str, FittedParameter]
    """Fitted parameter -> the value with its 95 % interval, as a change of the base."""
    unknown: tuple[str, ...]
    """Parameters that these flights do not show; they stay as in the base."""
    false_alarms: Mapping[str, str] = field(default_factory=dict)
    """Name of a healthy flight that the vehicle of the others calls faulty -> summary."""


def fit_vehicle(
    logs: Sequence[Flight], base: VehicleFile, progress: ProgressCallback = no_progress
) -> VehicleFit:
    """Fit a vehicle to healthy flights; mass and geometry are those of the base.

    Where logs have rotor speeds, the thrust of the propellers is fitted; where they have motor
    commands from 0 to 1, the drive that makes thrust of them. Each flight is then diagnosed with
    the vehicle that the others show: the file has the spread of healthy flights, and how often a
    cause was named in one.

    Args:
        logs: flights, checked.
        base: the prior vehicle; parameters that the flights don't show keep their value.
        progress: called with a stage and the share done.

    Raises:
        InputError: no flight that can be used, or neither commands nor speeds.
    """
    count = len(logs)
    folds = min(count, _MOST_FITS)
    steps = 1.0 + folds + 2.0 * count if count > 1 else 1.0
    progress(f"fitting {count} flights", 0.0)
    whole = _fit(logs, base)
    if count < 2:
        return whole
    differences: dict[int, FlightProblem] = {}
    fits: dict[int, VehicleFit] = {}
    for fold in range(folds):
        left_out = range(fold, count, folds)
        names = ", ".join(logs[k].name for k in left_out)
        progress(f"fitting without {names}", (1.0 + fold + len(differences)) / steps)
        fit = _fit([log for k, log in enumerate(logs) if k not in left_out], base)
        for k in left_out:
            fits[k] = fit
            differences[k] = _difference(logs[k], fit.file)
    false_alarms = {}
    for k, fit in fits.items():
        progress(f"diagnosing {logs[k].name} by the others", (1.0 + folds + count + k) / steps)
        others = [each for j, each in differences.items() if j != k]
        file = dataclasses.replace(fit.file, healthy=_healthy(fit.file, others))
        diagnosis, _ = diagnose_flights(held_against([logs[k]], file), nominal_model(vehicle=file))
        if diagnosis.verdict != "none":
            false_alarms[logs[k].name] = diagnosis.summary
    healthy = dataclasses.replace(
        _healthy(whole.file, list(differences.values())), left_out=count, accused=len(false_alarms)
    )
    file = dataclasses.replace(whole.file, healthy=healthy)
    return dataclasses.replace(whole, file=file, false_alarms=false_alarms)


def _fit(logs: Sequence[Flight], base: VehicleFile) -> VehicleFit:
    """Fit a vehicle to flights; their residual is in it as the usual one."""
    file = base
    if not all(log.has_rotor_speeds for log in logs):
        file = _with_fitted_drive(logs, base)
    file = _with_supply(logs, file)
    held = held_against(logs, file)
    problem = FlightProblem([track_of(log) for log in held], nominal_model(vehicle=file))
    free = {p.label: p for p in problem.nominal.parameters if p.label in FITTED}
    if file.drive.known:
        free.pop("thrust_coefficient_error.fraction")  # the drive has taken it up
    fit = _fit_of_shown(problem, [p.index for p in free.values()])
    seen = {
        p.label: fitted_parameter(
            p,
            float(problem.theta[p.index]),
            float(fit.theta[p.index]),
            _deviation(problem, fit, p),
        )
        for p in free.values()
        if p.index in fit.free
    }
    left = residual_variances(problem, fit)
    spread = {
        p.label: _alone_deviation(problem, fit, p)
        for p in free.values()
        if p.label in seen or not _is_known(base, p.label)
    }
    healthy = HealthyFlights(len(logs), _by_channel(left), spread)
    file = dataclasses.replace(file, healthy=healthy, effects=_with_noise(problem, fit, file))
    count = len(logs)
    unseen = tuple(text for label, text in FITTED.items() if label in free and label not in seen)
    return VehicleFit(_with_fitted(file, seen, count), seen, unseen)


def _fit_of_shown(problem: FlightProblem, wanted: Sequence[int]) -> Fit:
    """Return the fit of those of the parameters that the flights show.

    The least visible parameters return to the base, one after the other: where they show a
    difference alone, of the yaw of IMU and markers for example, one of the two takes it.
    """
    unknowns = problem.unknowns
    free = [i for i in wanted if i in unknowns.identifiable]
    fit = problem.fit(free, NOMINAL_WIDTHS, problem.null_hypothesis)

    def shares(some: Sequence[int]) -> Array:
        """Return the deviations of parameters over their sizes, if just these are free."""
        priors = unknowns.deviations(some, NOMINAL_WIDTHS, pinned=fit.pinned)
        covariance = solve(fit.normal, priors, fit.prior_mean).covariance
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))[unknowns.places(some)]
        return np.asarray(deviations / [unknowns.parameters[i].scale for i in some])

    while free:
        dropped: list[int] = []
        while free and (share := shares(free)).max() >= _MAX_RELATIVE_DEVIATION:
            dropped.append(free.pop(int(np.argmax(share))))
        for index in reversed(dropped):  # what hid one may be gone now
            if shares([*free, index]).max() < _MAX_RELATIVE_DEVIATION:
                free.append(index)
        fit = problem.fit(free, NOMINAL_WIDTHS, fit, slopes=False)
        shown = [i for i in free if _inside(problem, fit, unknowns.parameters[i])]
        if shown == free:
            break
        free = shown
    return fit if free else problem.null_hypothesis


def _deviation(problem: FlightProblem, fit: Fit, p: FreeParameter) -> float:
    (place,) = problem.unknowns.places([p.index])
    return math.sqrt(max(float(fit.solution.covariance[place, place]), 0.0))


def _inside(problem: FlightProblem, fit: Fit, p: FreeParameter) -> bool:
    """Return whether a fitted value is clear of its bounds, or at the value without effect."""
    value, deviation = float(fit.theta[p.index]), _deviation(problem, fit, p)
    return p.low + deviation < value < p.high - deviation or value == p.null


def _alone_deviation(problem: FlightProblem, fit: Fit, p: FreeParameter) -> float:
    """Return how well flights know one parameter, all others within their tolerances.

    Parameters that they don't show may have any usual size: flights that do show it are not to be
    blamed.
    """
    unknowns = problem.unknowns
    if p.index not in unknowns.identifiable:
        return p.scale
    (place,) = unknowns.places([p.index])
    solution = solve(
        fit.normal, unknowns.deviations((p.index,), fit.prior_std_scale, pinned=fit.pinned)
    )
    return math.sqrt(max(float(solution.covariance[place, place]), 0.0))


def _is_known(base: VehicleFile, label: str) -> bool:
    """Return whether the base itself says how well it knows what a parameter changes."""
    return any(
        effect == label and base.tolerance(key) is not None
        for key, (effect, _) in EFFECT_OF.items()
    )


def _by_channel(left: ScaleVariances) -> dict[str, tuple[float, ...]]:
    return {
        name: tuple(float(v) for v in np.nan_to_num(left.variances[:, j]))
        for j, name in enumerate(left.names)
    }


def _difference(log: Flight, file: VehicleFile) -> FlightProblem:
    """Return a flight about a vehicle that it was not fitted to."""
    (held,) = held_against([log], file)
    return FlightProblem([track_of(held)], nominal_model(vehicle=file))


def _healthy(file: VehicleFile, differences: Sequence[FlightProblem]) -> HealthyFlights:
    """Return the spread of healthy flights, from the difference of each to the others.

    Of parameters, the spread that explains the differences best; the largest residual of a further
    flight. Rotors differ from session to session at least as those of other vehicles.
    """
    assert file.healthy is not None
    known, differ = file.healthy.spread, _spread(differences)
    spread = {
        label: math.hypot(known.get(label, 0.0), differ.get(label, 0.0))
        for label in dict.fromkeys((*known, *differ))
    }
    spread[SCATTER_LABEL] = max(spread.get(SCATTER_LABEL, 0.0), SESSION_SCATTER)
    left = [_left_within(problem, spread) for problem in differences]
    names = dict.fromkeys(name for each in left for name in each)
    residuals = {name: _upper_bounds([v[name] for v in left if name in v]) for name in names}
    return HealthyFlights(file.healthy.flights, residuals, spread)


def _left_within(
    problem: FlightProblem, spread: Mapping[str, float]
) -> dict[str, tuple[float, ...]]:
    """Return the variances by channel that a flight's differences within a spread leave."""
    width = spread[SCATTER_LABEL] / scatter_unit(problem.theta, problem.nominal)
    wide = problem.with_spread(spread, width)
    return _by_channel(residual_variances(wide, wide.null_hypothesis))


def _upper_bounds(variances: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """Return variances (scales) that those of a further flight pass in 2.5 %.

    `variances` (flights, scales), 0 where a flight is too short: their logarithms are normal, with
    one deviation at all scales.
    """
    values = np.asarray(variances, np.float64)
    shown = values > 0.0
    logs = np.where(shown, np.log(np.where(shown, values, 1.0)), 0.0)
    counts = shown.sum(axis=0)
    bound = logs.sum(axis=0) / np.maximum(counts, 1)
    freedom = int(np.maximum(counts - 1, 0).sum())
    if freedom:
        variance = float(np.sum(np.where(shown, logs - bound, 0.0) ** 2)) / freedom
        deviation = math.sqrt(variance * (1.0 + 1.0 / len(values)))
        bound = bound + float(stats.t.ppf(0.975, freedom)) * deviation
    return tuple(float(v) for v in np.where(counts > 0, np.exp(bound), 0.0))


def _spread(flights: Sequence[FlightProblem]) -> dict[str, float]:
    """Return effect.parameter -> its deviation from flight to flight, where it is more than usual.

    The variances of all parameters together that make the flights most probable, by expectation
    and maximisation from their tolerances up: of several parameters that would explain the same
    difference none has to explain it alone. Of few flights a deviation is known badly: Student's
    factor makes it as wide as one that is known well.
    """
    names = [_labels(flight) for flight in flights]
    units = [
        np.r_[
            np.ones(len(f.unknowns.indices)),
            np.full(len(f.unknowns.draws), scatter_unit(f.theta, f.nominal)),
        ]
        for f in flights
    ]
    usual: dict[str, float] = {}
    for flight, labels, unit in zip(flights, names, units, strict=True):
        usual |= dict(zip(labels, unit * flight.unknowns.deviations(), strict=True))
    normals = [flight.normal() for flight in flights]
    variance = {label: tolerance**2 for label, tolerance in usual.items()}
    for _ in range(_EM_STEPS):
        squares: dict[str, list[float]] = {}
        for labels, unit, normal in zip(names, units, normals, strict=True):
            deviations = np.sqrt([variance[label] for label in labels]) / unit
            solution = solve(normal, deviations)
            each = unit**2 * (solution.mean**2 + np.diag(solution.covariance))
            for label, square in zip(labels, each, strict=True):
                squares.setdefault(label, []).append(float(square))
        variance = {n: max(float(np.mean(v)), usual[n] ** 2) for n, v in squares.items()}
    factor = float(stats.t.ppf(0.975, len(flights))) / TWO_SIDED
    more = {n: math.sqrt(v - usual[n] ** 2) for n, v in variance.items()}
    return {n: math.hypot(usual[n], factor * m) for n, m in more.items() if m > usual[n]}


def _labels(flight: FlightProblem) -> list[str]:
    """Return the effect.parameter of every column; all draws are of one."""
    unknowns = flight.unknowns
    return [unknowns.parameters[i].label for i in unknowns.indices] + [
        SCATTER_LABEL for _ in unknowns.draws
    ]


def _with_notes(file: VehicleFile, notes: Mapping[str, Note], **changed: Any) -> VehicleFile:
    """Return a vehicle with changed sections, and notes on the values that it states."""
    given, every = file.given | {*notes}, {**file.notes, **notes}
    return dataclasses.replace(file, notes=every, given=given, **changed)


def _with_supply(logs: Sequence[Flight], file: VehicleFile) -> VehicleFile:
    """Return a vehicle with the highest voltage that its flights begin with."""
    volts = [log.series["voltage"].values[:, 0] for log in logs if "voltage" in log.series]
    full = max((float(np.nanmax(v[: max(1, v.size // 20)])) for v in volts), default=math.nan)
    if not math.isfinite(full):
        return file
    values = {**dataclasses.asdict(file.vehicle), "battery_voltage": full}
    vehicle = from_mapping(VehicleParams, values, "vehicle")
    notes = {"vehicle.battery_voltage": Note(None, "highest in these flights")}
    return _with_notes(file, notes, vehicle=vehicle)


def _with_noise(
    problem: FlightProblem, fit: Fit, file: VehicleFile
) -> dict[str, dict[str, float]]:
    """Return a vehicle's effects with the noise that its flights show, where it is another."""
    effects = {name: dict(values) for name, values in file.effects.items()}
    parameters = problem.nominal.parameters
    for noise_fit in select_noise_fits(
        fit_noise_effects(problem.tracks, problem.nominal, fit.theta)
    ):
        for index, value in zip(noise_fit.free, noise_fit.value, strict=True):
            effects.setdefault(noise_fit.effect, {})[parameters[index].name] = float(value)
    return effects


def _with_fitted_drive(logs: Sequence[Flight], base: VehicleFile) -> VehicleFile:
    """Return the base with a drive: thrust by command and supply."""
    drive, error = fit_drive(logs, base.vehicle.mass)
    notes = {
        f"drive.{name}": Note(None, f"fitted to {len(logs)} flights")
        for name in ("gain", "offset", "supply_exponent", "supply")
    }
    notes["drive.gain"] = dataclasses.replace(
        notes["drive.gain"], tolerance=max(error * drive.gain, 1e-9)
    )
    return _with_notes(base, notes, drive=drive)


def fit_drive(logs: Sequence[Flight], mass: float) -> tuple[DriveParams, float]:
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
        solution = least_squares(lambda x: predicted(x, rows) - rows[:, 2], start, loss="soft_l1")
        return np.asarray(solution.x)

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


def _drive_samples(log: Flight) -> Array:
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
    deviations: dict[str, float] = {}
    effects = {name: dict(values) for name, values in file.effects.items()}
    for label, fitted in seen.items():
        effect, _, name = label.partition(".")
        deviation = (fitted.high - fitted.low) / (2.0 * TWO_SIDED)
        if effect == "inertia_error":
            old = getattr(vehicle, f"inertia_{name}")
            new = old * (1.0 + fitted.value)
            vehicle = dataclasses.replace(vehicle, **{f"inertia_{name}": new})
            deviations[f"vehicle.inertia_{name}"] = old * deviation
        elif effect == "motor_lag":
            new = max(vehicle.motor_time_constant + fitted.value, 1e-3)
            vehicle = dataclasses.replace(vehicle, motor_time_constant=new)
            deviations["vehicle.motor_time_constant"] = deviation
        elif effect == "thrust_coefficient_error" and propeller.k_thrust > 0.0:
            old = propeller.k_thrust
            propeller = dataclasses.replace(propeller, k_thrust=old * (1.0 + fitted.value))
            deviations["propeller.k_thrust"] = old * deviation
        else:
            effects.setdefault(effect, {})[name] = fitted.value
    about = f"fitted to {flights} flights"
    notes = {key: Note(max(value, 1e-12), about) for key, value in deviations.items()}
    return _with_notes(
        file, notes, vehicle=vehicle, propeller=propeller, effects=effects,
        about=file.about or about,
    )  # fmt: skip
