"""A vehicle file from flights without poses, and the page about it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tombo_bag.flight import Flight
from tombo_diagnosis.flight.fit.inertial_fit import (
    InertialFit,
    deviations,
    fit_inertial,
    inertial_flight,
)
from tombo_diagnosis.wording import figure
from tombo_dynamics.vehicle import DriveParams
from tombo_flight.report.page import Page, Section, Table, Text
from tombo_flight.vehicle_file import Note, VehicleFile, vehicle_text

_COMMANDS = (0.5, 0.6, 0.7)
"""At which the thrust curve is shown."""


def inertial_vehicle(
    logs: Sequence[Flight], base: VehicleFile
) -> tuple[VehicleFile, InertialFit, list[float]]:
    """Fit flights with gyro, accelerometer and motor commands.

    Args:
        logs: as read.
        base: mass, arms and whatever the flights don't show.

    Returns:
        The vehicle, the fit, and the deviations of thrust and both moments of inertia (3), as
        shares.

    Raises:
        InputError: a flight lacks a channel, or is too short.
    """
    flights = [inertial_flight(log) for log in logs]
    mass, arm = base.vehicle.mass, base.vehicle.arm_length
    fit = fit_inertial(flights, mass, arm)
    deviation = deviations(flights, mass, arm, fit).tolist()
    return _file(base, fit, deviation, len(logs)), fit, deviation


def _file(
    base: VehicleFile, fit: InertialFit, deviation: Sequence[float], count: int
) -> VehicleFile:
    source = f"fitted to {count} flights without poses"
    xx, yy = (float(value) for value in fit.inertia)
    half = 0.25 * (fit.bounds[:, 1] - fit.bounds[:, 0])
    vehicle = dataclasses.replace(
        base.vehicle, inertia_xx=xx, inertia_yy=yy, motor_time_constant=fit.lag
    )
    drive = fit.drive
    name, scale = max(("gain", drive.gain), ("curvature", drive.curvature), key=lambda x: x[1])
    notes = {
        "vehicle.inertia_xx": Note(float(np.hypot(half[0], deviation[1] * xx)), source),
        "vehicle.inertia_yy": Note(float(np.hypot(half[1], deviation[2] * yy)), source),
        "vehicle.motor_time_constant": Note(None, source),
        f"drive.{name}": Note(max(deviation[0] * scale, 1e-9), source),
    }
    known = [f"drive.{field.name}" for field in dataclasses.fields(DriveParams)]
    effects = {name: dict(values) for name, values in base.effects.items()}
    if fit.delay:
        effects["command_delay"] = {"delay": fit.delay}
    return dataclasses.replace(
        base, vehicle=vehicle, drive=drive, effects=effects, notes={**base.notes, **notes},
        given=base.given | {*notes, *known}, about=base.about or source,
    )  # fmt: skip


def inertial_page(
    file: VehicleFile, fit: InertialFit, deviation: Sequence[float], output: Path
) -> Page:
    """Return what `inertial_vehicle` returned as a page; `output`: the vehicle file."""
    share, *both = deviation
    rows = [
        (f"thrust of a rotor at command {command:g} [N]",
         figure(float(fit.drive.thrust(np.full((1, 4), command))[0, 0])),
         f"± {100.0 * share:.1f} %")
        for command in _COMMANDS
    ]  # fmt: skip
    rows += [
        (f"moment of inertia about {axis} [kg m²]", figure(float(fit.inertia[k])),
         f"± {100.0 * both[k]:.1f} %; noise allows {figure(float(fit.bounds[k, 0]))} to "
         f"{figure(float(fit.bounds[k, 1]))}")
        for k, axis in enumerate("xy")
    ]  # fmt: skip
    rows += [
        ("motor time constant [s]", figure(fit.lag), ""),
        ("delay before it [s]", figure(fit.delay), ""),
    ]
    name = file.name
    unseen = (
        "Not shown without poses, as before: drag, centre of gravity, moment of inertia about z."
    )
    return Page(
        title=name,
        eyebrow="vehicle from flights without poses",
        headline=f"{name}, as gyro, accelerometer and commands show it",
        summary="",
        sections=[
            Section("", [Table(("fitted", "value", "how well"), rows)]),
            Section("", [Text([unseen, f"Wrote {output}."])]),
        ],
        data={
            "name": name,
            "fit": dataclasses.asdict(fit),
            "deviation": list(deviation),
            "file": vehicle_text(file),
        },
    )
