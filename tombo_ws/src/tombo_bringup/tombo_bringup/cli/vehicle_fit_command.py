"""`tombo vehicle from-flights`: a vehicle file from healthy flights."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING

from tombo_bringup.cli import options
from tombo_bringup.cli.options import option, record
from tombo_bringup.cli.progress import progress_bar
from tombo_bringup.cli.result_files import YAML, check_new_file
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bag.flight import Flight
    from tombo_diagnosis.flight.vehicle_fit import VehicleFit
    from tombo_flight.report.page import Page
    from tombo_flight.vehicle_file import VehicleFile


@record
class _Flights(options.Logs):
    output: Path = option("-o/--output FILE", "What to write, a .yaml.", ...)
    mass: float | None = option(
        "--mass KG", "Mass at take-off, as weighed: flights show thrust over mass only."
    )


def from_flights(
    flights: _Flights,
    known: options.VehicleName,
    reading: options.LogMapping,
    force: options.Force,
    shown: options.Shown,
) -> None:
    """Fit thrust, motor lag, inertia and drag to healthy flights, and write a vehicle file.

    Each value gets its tolerance; values that the flights could not show are listed, and stay
    as they were known before. Each flight is then diagnosed with the vehicle that the
    others show: how often a healthy one is accused limits the confidence of
    `tombo diagnose --vehicle FILE`, which compares other flights with this vehicle.
    Without poses gyro, accelerometer and motor commands will do: thrust curve, inertia
    and motor lag are fitted then.
    """
    from tombo_bringup.cli.tables import show_page
    from tombo_dynamics.params import from_mapping
    from tombo_dynamics.vehicle import VehicleParams

    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    output, vehicle, mass = flights.output, known.vehicle, flights.mass
    check_new_file(output, force.force, YAML)
    if mass is not None:
        from_mapping(VehicleParams, {"mass": mass}, "--mass: vehicle")
    with progress_bar() as on_progress:
        from tombo_diagnosis.flight.diagnose import check_flights
        from tombo_diagnosis.flight.vehicle_fit import fit_vehicle
        from tombo_flight.vehicle_file import write_vehicle
        from tombo_logs.readers.log_reader import read_logs

        read = read_logs(flights.logs, mapping=reading.mapping)
        if not any("position" in log.series for log in read):
            page = _inertial(read, _base(read, vehicle, mass), output)
            show_page(page, shown.as_json)
            return
        healthy, refused = check_flights(read, progress=on_progress)
        if refused:  # healthy flights are all to be fit for use
            raise InputError(refused[0].message)
        base = _base(healthy, vehicle, mass)
        fit = fit_vehicle(healthy, base, on_progress)
        write_vehicle(output, fit.file)
    show_page(_page(fit, output), shown.as_json)


def _base(flights: list[Flight], vehicle: str | None, mass: float | None) -> VehicleFile:
    """Return the vehicle as known without its flights."""
    from tombo_diagnosis.flight.calibrate import speed_in_hover
    from tombo_flight.vehicle_file import Note, read_vehicle
    from tombo_logs.readers.vehicle_airframe import vehicle_of

    frames = [log.airframe for log in flights if log.airframe is not None]
    if vehicle is not None:
        base = read_vehicle(vehicle)
    elif frames:
        frame = frames[0] if mass is None else dataclasses.replace(frames[0], mass=mass)
        speeds = all(log.has_rotor_speeds for log in flights)
        base = vehicle_of(frame, speed_in_hover(flights) if speeds else None)
    else:
        base = read_vehicle("tombo_s500")
    if mass is None:
        return base
    weighed = dataclasses.replace(base.vehicle, mass=mass)
    notes = {**base.notes, "vehicle.mass": Note(None, "weighed")}
    return dataclasses.replace(
        base, vehicle=weighed, notes=notes, given=base.given | {"vehicle.mass"}
    )


def _inertial(flights: list[Flight], base: VehicleFile, output: Path) -> Page:
    """Fit flights without poses, write the vehicle file, return the page."""
    from tombo_diagnosis.flight.inertial_vehicle import inertial_page, inertial_vehicle
    from tombo_flight.vehicle_file import write_vehicle

    file, fit, deviation = inertial_vehicle(flights, base)
    write_vehicle(output, file)
    return inertial_page(file, fit, deviation, output)


def _page(fit: VehicleFit, output: Path) -> Page:
    from tombo_diagnosis.flight.fit.problem import healthy_confidence
    from tombo_diagnosis.flight.vehicle_fit import FITTED
    from tombo_diagnosis.wording import figure, unit
    from tombo_flight.command_line import command_line
    from tombo_flight.report.page import Page, Section, Table, Text
    from tombo_flight.vehicle_file import vehicle_text

    rows = [
        (
            FITTED[label],
            f"{figure(value.value)} {unit(value.unit)}".strip(),
            f"{figure(value.low)} to {figure(value.high)}",
        )
        for label, value in fit.fitted.items()
    ]
    drive, lines = fit.file.drive, []
    if drive.known:
        lines.append(
            f"Drive: a rotor's thrust is ({figure(drive.offset)} + {figure(drive.gain)} command) "
            f"(V / {figure(drive.supply)})^{figure(drive.supply_exponent)} N"
        )
    doubts = [f"Not shown by these flights, as before: {text}." for text in fit.unknown]
    healthy = fit.file.healthy
    assert healthy is not None
    most = f"A diagnosis with this vehicle is at most {healthy_confidence(healthy):.0%} confident."
    if healthy.left_out:
        doubts += [
            f"{name}, diagnosed by the others, is accused: {text}"
            for name, text in fit.false_alarms.items()
        ]
        doubts.append(
            f"Diagnosed by the others, {healthy.accused} of {healthy.left_out} healthy flights "
            f"are accused. {most}"
        )
    else:
        doubts.append(f"A single flight can't be held against others. {most}")
    diagnose = command_line(("diagnose", "NEW..."), [("--vehicle", str(output))])
    return Page(
        title=fit.file.name,
        eyebrow="vehicle from flights",
        headline=f"{fit.file.name}, as its flights show it",
        summary="",
        sections=[
            Section(
                "",
                [
                    Table(("fitted", "change", "95 % interval"), rows),
                    Text(lines),
                    Text(doubts, style="warn"),
                    Text([f"Wrote {output}. Next, with other flights in place of NEW...:"]),
                    Text([f"  {diagnose}"], "command"),
                ],
            )
        ],
        data={
            "name": fit.file.name,
            "fitted": {label: dataclasses.asdict(value) for label, value in fit.fitted.items()},
            "unseen": list(fit.unknown),
            "accused": dict(fit.false_alarms),
            "file": vehicle_text(fit.file),
        },
    )
