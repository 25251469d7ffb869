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
    from tombo_flight.builtin_files import builtin_vehicles

    own = "Your own: tombo vehicle new my_vehicle.yaml, then tombo fly hover --vehicle it."
    print_names(builtin_vehicles(), own, shown.as_json)


@record
class _Name:
    name: str = argument("NAME|FILE", "A name of `tombo vehicle list`, or a file.")


@command(app)
def show(which: _Name, shown: options.Shown) -> None:
    """Show a vehicle's file and its hover; with --json also the values that follow from others."""
    from tombo_flight.json_text import as_json
    from tombo_flight.vehicle_file import read_vehicle, vehicle_text

    file = read_vehicle(which.name)
    hover = _hover(file)
    if shown.as_json:
        values = {**dataclasses.asdict(file), "given": sorted(file.given), "hover": hover}
        print(as_json(values), end="")
        return
    typer.echo(
        f"{vehicle_text(file)}# Hover: {hover['thrust_N']:.4g} N and {hover['speed_rad_s']:.4g} "
        f"rad/s a rotor ({hover['speed_rpm']:.0f} rpm), {hover['power_W']:.4g} W of shaft power "
        f"for all four, thrust to weight {hover['thrust_to_weight']:.2f}"
    )


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


command(app, "from-flights")(from_flights)
