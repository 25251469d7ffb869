"""`tombo vehicle`: vehicles that can be flown, what one is made of, a file for one's own."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.errors import print_error
from tombo_bringup.cli.options import argument, command, option, record
from tombo_bringup.cli.result_files import check_new_yaml
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
_TORQUE_RATIO = 0.016
"""m: drag torque over thrust of many propellers of 5 to 13 inch; what `new` proposes."""


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


@record
class _NewVehicle:
    file: Path = argument("FILE", "What to write, a .yaml.")
    name: str | None = option("--name TEXT", "Name of the vehicle.")
    arm_length: float | None = option(
        "--arm-length M", "Centre to rotor axis.", accepted="a number [m]"
    )
    conf: int | None = option("--conf N", "Tombo propellers, a configuration of Table I.")
    k_thrust: float | None = option("--k-thrust K", "Plain propellers: N s^2/rad^2.")
    k_torque: float | None = option("--k-torque K", "Plain propellers: N m s^2/rad^2.")
    radius: float | None = option(
        "--radius M", "Plain propellers: tip radius.", accepted="a number [m]"
    )
    on_impact: str | None = option("--on-impact WHAT", "Plain propellers: rigid, breaks or folds.")


@command(app)
def new(
    given: _NewVehicle, mass: options.Mass, more: options.Settings, force: options.Force
) -> None:
    """Ask for what is not given as an option, and write a vehicle file that flies.

    What is asked: name, mass, arm length, and the propeller. Everything else is taken from these
    and can be changed in the file, or by --set, as in vehicle.inertia_xx=0.012 or
    vehicle.mass={value: 1.5, tolerance: 0.005, source: weighed}.
    """
    from tombo_flight.command_line import command_line
    from tombo_flight.scenario import override
    from tombo_flight.vehicle_file import FORMAT, vehicle_from_mapping, write_vehicle

    file = given.file
    check_new_yaml(file, force.force)
    known: dict[str, Any] = {}
    for setting in more.settings or []:
        known = override(known, setting, example="vehicle.mass=1.4")
    label = given.name if given.name is not None else _ask("--name", "Name", file.stem)
    values = _FileValues(known)
    values.put("vehicle.mass", mass.mass, "--mass", "Mass at take-off [kg]")
    values.put("vehicle.arm_length", given.arm_length, "--arm-length", "Centre to rotor axis [m]")
    _propeller(values, given)
    while True:
        content = {"tombo_vehicle": FORMAT, "name": label, **values.content}
        try:
            vehicle = vehicle_from_mapping(content, f"'{file}'")
            break
        except InputError as error:
            if not values.ask_again(str(error)):
                raise
    write_vehicle(file, vehicle)
    hover = _hover(vehicle)
    typer.echo(
        f"{file}: hovers at {hover['speed_rpm']:.0f} rpm with {hover['power_W']:.3g} W of shaft "
        f"power. Fly it: {command_line(('fly', 'hover'), [('--vehicle', str(file))])}"
    )


class _FileValues:
    """The values of a new file: settings, then options, then answers."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self.content = settings
        self._asked: dict[str, tuple[str, str]] = {}
        """Key → option and question of what was answered."""

    def has(self, key: str) -> bool:
        section, _, name = key.partition(".")
        entries = self.content.get(section)
        return isinstance(entries, dict) and name in entries

    def put(
        self, key: str, value: Any, flag: str, question: str = "", default: Any = None
    ) -> None:
        """Take a value; ask for it where it is None and there is a question."""
        if value is None and (self.has(key) or not question):
            return
        if value is None:
            value = _ask(flag, question, default)
            self.answered(key, flag, question)
        section, _, name = key.partition(".")
        entries = self.content.setdefault(section, {})
        if isinstance(entries, dict):
            entries[name] = value

    def answered(self, key: str, flag: str, question: str) -> None:
        """Note that a value is an answer, which may be asked for again."""
        self._asked[key] = flag, question

    def ask_again(self, problem: str) -> bool:
        """Say what is wrong, ask again for the answers that it names; False: it names none.

        The other answers stay; an answer that is named may stay, too.
        """
        named = [key for key in self._asked if key in problem]
        if not named or sys.stdin is None or not sys.stdin.isatty():
            return False
        print_error(problem)
        for key in named:
            section, _, name = key.partition(".")
            self.content[section][name] = _ask(*self._asked[key], self.content[section][name])
        return True


def _propeller(values: _FileValues, given: _NewVehicle) -> None:
    """Take the propeller, or ask for it."""
    conf = given.conf
    plain = given.k_thrust is not None or any(
        values.has(key) for key in ("propeller.curve", "propeller.k_thrust")
    )
    asks = not plain
    if plain and conf is not None and given.on_impact != "folds":
        raise InputError(f"--conf {conf}: accepted: without --k-thrust, or with --on-impact folds")
    if conf is None and not plain and not values.has("propeller.conf"):
        answer = _ask(
            "--conf or --k-thrust", "Propeller: a Tombo configuration (0 to 13), or plain", "plain"
        )
        plain = str(answer).strip().lower() == "plain"
        if not plain:
            conf = _whole(str(answer))
            values.answered("propeller.conf", "--conf", "A Tombo configuration (0 to 13)")
    values.put("propeller.conf", conf, "--conf")
    if not plain:
        for name in ("k_torque", "radius", "on_impact"):
            if (value := getattr(given, name)) is not None:
                flag = f"--{name.replace('_', '-')}"
                raise InputError(f"{flag} {value}: accepted: with --k-thrust only")
        return
    if not values.has("propeller.curve"):
        question = "Thrust over speed squared [N s^2/rad^2]"
        values.put("propeller.k_thrust", given.k_thrust, "--k-thrust", question)
        k = values.content["propeller"]["k_thrust"]
        k = k["value"] if isinstance(k, dict) else k
        usual = float(f"{_TORQUE_RATIO * k:.4g}") if isinstance(k, float) else None
        question = "Drag torque over speed squared [N m s^2/rad^2]"
        values.put("propeller.k_torque", given.k_torque, "--k-torque", question, usual)
    values.put("propeller.radius", given.radius, "--radius", "Tip radius [m]")
    question = "When it strikes: rigid, breaks or folds"
    question = question if asks else ""
    values.put("propeller.on_impact", given.on_impact, "--on-impact", question, "breaks")


def _ask(flag: str, question: str, default: Any = None) -> Any:
    """Return the answer: a number where nothing or a number is proposed.

    Raises:
        InputError: there is no one to ask.
    """
    kind = float if default is None else type(default)
    if sys.stdin is not None and sys.stdin.isatty():
        return typer.prompt(question, default=default, type=kind)
    line = "" if sys.stdin is None else sys.stdin.readline()
    answer = line.strip() or default
    if answer is None:
        raise InputError(f"{flag}: missing; accepted: the option, or an answer: {question}")
    try:
        return kind(answer)
    except ValueError:
        raise InputError(f"{flag}: '{answer}' is no number: {question}") from None


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"propeller '{text}': accepted: 0 to 13, or plain") from None


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
    from tombo_flight.report.page import Page, Section, Table, TableRow, Text

    rows: list[TableRow | tuple[str, ...]] = []
    for section in ("vehicle", "propeller", "control"):
        rows += [TableRow([section], "group"), *_rows(file, section)]
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
