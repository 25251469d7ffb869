"""`tombo vehicle`: list vehicles, show one, write a file for one's own."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import argument, command, record
from tombo_bringup.cli.result_files import YAML, check_new_file
from tombo_bringup.cli.vehicle_fit_command import from_flights
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_flight.report.page import Page
    from tombo_flight.vehicle_file import VehicleFile

app = typer.Typer(
    name="vehicle",
    no_args_is_help=True,
    help="List vehicles, show one, or write a file for your own.",
    context_settings=options.HELP_OPTIONS,
)


@command(app, "list")
def list_vehicles(shown: options.Shown) -> None:
    """List the vehicles that come with the suite."""
    from tombo_bringup.cli.tables import print_names
    from tombo_flight.vehicle_file import builtin_vehicles

    own = "Your own: tombo vehicle new my_vehicle.yaml, then tombo fly hover --vehicle it."
    print_names(builtin_vehicles(), own, shown.as_json)


@record
class _Name:
    name: str = argument("NAME|FILE", "A name of `tombo vehicle list`, or a file.")


@command(app)
def show(which: _Name, shown: options.Shown) -> None:
    """Show each value of a vehicle, where it is from, and its hover."""
    from tombo_bringup.cli.tables import show_page
    from tombo_flight.vehicle_file import read_vehicle

    show_page(_page(read_vehicle(which.name)), shown.as_json)


@command(app)
def urdf(which: _Name) -> None:
    """Print a vehicle as URDF, with folding blades, for robot_state_publisher."""
    from tombo_flight.urdf import vehicle_urdf
    from tombo_flight.vehicle_file import read_vehicle

    typer.echo(vehicle_urdf(read_vehicle(which.name)), nl=False)


@record
class _NewFile:
    file: Path = argument("FILE", "What to write, a .yaml.")


@command(app)
def new(given: _NewFile, values: options.Settings, force: options.Force) -> None:
    """Write a vehicle file that flies, from mass, arm length and propeller, each by --set.

    vehicle.mass in kg, vehicle.arm_length in m, from the centre to a rotor's axis, and of Tombo
    propellers propeller.conf; of plain ones propeller.k_thrust in N s^2/rad^2, propeller.k_torque
    in N m s^2/rad^2 and propeller.radius in m. Everything else is taken from these and can be set
    in the same way, or changed in the file: name=Mine,
    vehicle.mass={value: 1.5, tolerance: 0.005, source: weighed}.
    """
    from tombo_flight.command_line import command_line
    from tombo_flight.scenario import override
    from tombo_flight.vehicle_file import FORMAT, vehicle_from_mapping, write_vehicle

    file = given.file
    check_new_file(file, force.force, YAML)
    content: dict[str, Any] = {"tombo_vehicle": FORMAT, "name": file.stem}
    for setting in values.settings or []:
        content = override(content, setting, example="vehicle.mass=1.4")
    propeller = content.get("propeller")
    if isinstance(propeller, dict) and "k_thrust" in propeller:
        if "conf" in propeller and propeller.get("on_impact") != "folds":
            raise InputError(
                "propeller.conf and propeller.k_thrust: accepted: one, or with "
                "propeller.on_impact=folds"
            )
        propeller.setdefault("on_impact", "breaks")
    vehicle = vehicle_from_mapping(content, f"'{file}'")
    write_vehicle(file, vehicle)
    hover = _hover(vehicle)
    typer.echo(
        f"{file}: hovers at {hover['speed_rpm']:.0f} rpm with {hover['power_W']:.3g} W of shaft "
        f"power. Fly it: {command_line(('fly', 'hover'), [('--vehicle', str(file))])}"
    )


def _hover(file: VehicleFile) -> dict[str, float]:
    from tombo_dynamics.propeller import RPM
    from tombo_dynamics.rotor_maps import hover_point

    maps = file.maps
    point = hover_point(maps, file.vehicle)
    return {
        "thrust_N": point.thrust,
        "speed_rad_s": point.speed,
        "speed_rpm": point.speed / RPM,
        "torque_Nm": point.torque,
        "power_W": point.power,
        "thrust_to_weight": float(maps.thrust_highest) / point.thrust,
    }


def _page(file: VehicleFile) -> Page:
    """Return each value of a vehicle, where it is from, and its hover."""
    from tombo_dynamics.effects import REGISTRY
    from tombo_flight.report.page import Page, Section, Table, TableRow, Text

    rows: list[TableRow | tuple[str, ...]] = []
    for section in ("vehicle", "propeller", "drive", "control"):
        if section != "drive" or file.drive.known:
            rows += [TableRow([section], "group"), *_rows(file, section)]
    for name, theta in file.effects.items():
        units = {p.name: p.unit for p in REGISTRY[name].theta}
        rows.append(TableRow([f"effect {name}"], "group"))
        rows += [(key, f"{value:.4g}", units[key], "", "") for key, value in theta.items()]
    hover = _hover(file)
    words = (
        f"Hover: {hover['thrust_N']:.4g} N and {hover['speed_rad_s']:.4g} rad/s a rotor "
        f"({hover['speed_rpm']:.0f} rpm), {hover['power_W']:.4g} W of shaft power for all four, "
        f"thrust to weight {hover['thrust_to_weight']:.2f}"
    )
    sources = [f"[{i + 1}] {source}" for i, source in enumerate(file.sources)]
    return Page(
        title=file.name,
        eyebrow="vehicle",
        headline=file.name,
        summary=file.about,
        sections=[
            Section("", [Table(("", "value", "unit", "tolerance", "from"), rows), Text(sources)]),
            Section("", [Text([words])]),
        ],
        data={
            "name": file.name,
            "about": file.about,
            "vehicle": dataclasses.asdict(file.vehicle),
            "propeller": dataclasses.asdict(file.propeller),
            "drive": dataclasses.asdict(file.drive),
            "control": dataclasses.asdict(file.control),
            "effects": {name: dict(theta) for name, theta in file.effects.items()},
            "sources": list(file.sources),
            "notes": {key: dataclasses.asdict(note) for key, note in file.notes.items()},
            "hover": hover,
        },
    )


def _rows(file: VehicleFile, section: str) -> list[tuple[str, ...]]:
    """Return name, value, unit, tolerance and source of the values of a section."""
    record = getattr(file, section)
    rows: list[tuple[str, ...]] = []
    for f in dataclasses.fields(record):
        key, value = f"{section}.{f.name}", getattr(record, f.name)
        if section == "propeller" and key not in file.given and value == f.default:
            continue
        tolerance = file.tolerance(key)
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        if f.name == "curve" and value is not None:
            shown = f"{len(value)} points"
        rows.append(
            (
                f.name,
                shown,
                str(f.metadata.get("unit", "")),
                "" if tolerance is None else f"{tolerance:.3g}",
                _source(file, key),
            )
        )
    return rows


def _source(file: VehicleFile, key: str) -> str:
    """Return where a value is from."""
    if key in file.notes or key in file.given:
        return file.notes[key].source if key in file.notes else ""
    if key == "vehicle.rotor_radius":
        return "the propeller"
    return "rule" if key.startswith("control.") else "as the S500, in this size"


command(app, "from-flights")(from_flights)
