"""`tombo lab`: write a lab file, and list its gaps."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import argument, command, record
from tombo_bringup.cli.result_files import YAML, check_new_file
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bringup.lab_file import Lab

app = typer.Typer(
    name="lab",
    no_args_is_help=True,
    help="Write the file of a lab, or say what it lacks.",
    context_settings=options.HELP_OPTIONS,
)

_QUESTIONS = {
    "vehicle": ("vehicle, a name of `tombo vehicle list` or a file", "tombo_s500"),
    "mocap.system": ("motion capture: optitrack, vicon, qualisys, vrpn or ros", "optitrack"),
    "mocap.host": ("address of the motion-capture computer, or the driver's topic", ""),
    "mocap.body": ("name of the rigid body", "tombo"),
    "mocap.up": ("its upward axis: z_up or y_up", "z_up"),
    "px4.url": ("link to PX4, as serial:///dev/ttyUSB0:921600", "udpin://127.0.0.1:14540"),
    "volume.x_min": ("volume that the net holds: x_min [m]", -2.0),
    "volume.x_max": ("x_max [m]", 2.0),
    "volume.y_min": ("y_min [m]", -1.5),
    "volume.y_max": ("y_max [m]", 1.5),
    "volume.z_max": ("z_max [m]", 2.5),
}
"""Key → question and proposed answer."""
_HEAD = "# A lab: tombo fly --lab THIS_FILE, or TOMBO_LAB=THIS_FILE. docs/lab.md explains it.\n"
_ROOM_M = 3.0
"""Room that a bounce needs along x and y: it drifts by up to 1.5 m (docs/reactions.md)."""


@record
class _NewFile:
    file: Path = argument("FILE", "What to write, a .yaml.")


@record
class _LabFile:
    file: Path = argument("FILE", "A lab file.")


@command(app)
def new(given: _NewFile, values: options.Settings, force: options.Force) -> None:
    """Ask for vehicle, motion capture, PX4 and volume, and write a lab file.

    --set KEY=VALUE answers a question beforehand, as --set mocap.body=lab_1. Without a terminal
    the others get the proposed answers.
    """
    from tombo_bringup.lab_file import FORMAT, read_lab
    from tombo_flight.scenario import override
    from tombo_flight.yaml_file import write_yaml, yaml_of

    check_new_file(given.file, force.force, YAML)
    content: dict[str, Any] = {"tombo_lab": FORMAT}
    for setting in values.settings or []:
        content = override(content, setting, example="mocap.body=lab_1")
    for key, (question, proposed) in _QUESTIONS.items():
        section, _, name = key.rpartition(".")
        place = content.setdefault(section, {}) if section else content
        if name not in place:
            asks = sys.stdin.isatty()
            place[name] = typer.prompt(question, default=proposed) if asks else proposed
    if content["mocap"]["system"] == "ros":
        content["mocap"]["topic"] = content["mocap"].pop("host")
    content["px4"].setdefault("parameters", ["safe", "mocap"])
    order = ["tombo_lab", *dict.fromkeys(key.partition(".")[0] for key in _QUESTIONS)]
    content = {key: content[key] for key in dict.fromkeys((*order, *content))}
    write_yaml(given.file, _HEAD + yaml_of(content), f"'{given.file}'")
    typer.echo(f"{given.file} is written. What it lacks: tombo lab check {given.file}")
    read_lab(given.file)


class _Item(NamedTuple):
    name: str
    lacks: str
    """Empty: nothing."""


@command(app, epilog="Exit code: 0 when nothing is missing, 1 when something is, 2 for bad input.")
def check(given: _LabFile, shown: options.Shown) -> None:
    """Say what a lab file lacks for a flight of a real vehicle."""
    from tombo_bringup.cli.tables import console
    from tombo_bringup.lab_file import read_lab

    items = list(_items(read_lab(given.file)))
    if shown.as_json:
        import json

        print(json.dumps([item._asdict() for item in items], indent=1))
    else:
        out = console(highlight=False)
        for item in items:
            out.print(f"{item.name:16} {item.lacks or 'ok'}")
    raise typer.Exit(1 if any(item.lacks for item in items) else 0)


def _items(lab: Lab) -> Iterator[_Item]:
    """Yield each item with its gap."""
    from tombo_flight.scenario import load_scenario
    from tombo_flight.suite.px4_connection import px4_connection

    text = "" if lab.vehicle else "no vehicle: `tombo vehicle new` writes one"
    volume = lack = ""
    try:
        scenario = load_scenario("hover", lab.settings, None, lab.vehicle or None)
        box = scenario.volume
        sizes = box.x_max - box.x_min, box.y_max - box.y_min
        if not all(0.0 < size < 1e3 for size in sizes):
            volume = "no volume: x_min, x_max, y_min, y_max, z_max of the net [m]"
        elif min(sizes) < _ROOM_M:
            volume = f"{min(sizes):g} m wide; a bounce needs {_ROOM_M:g} m along x and y"
    except InputError as error:
        volume, lack = "not known before the scenario is mended", str(error)
    yield _Item("vehicle", text)
    yield _Item("volume", volume)
    yield _Item("scenario", lack)
    mocap = lab.mocap
    yield _Item("motion capture", "no mocap: system, host, body" if mocap is None else "")
    body = mocap is not None and bool(mocap.body)
    yield _Item("tracked body", "" if body else "no mocap.body: the name of the rigid body")
    link = "no px4.url: as serial:///dev/ttyUSB0:921600"
    if lab.url:
        try:
            px4_connection(lab.url, lab.bridge)
            link = ""
        except InputError as error:
            link = str(error)
    yield _Item("PX4", link)
    sets = [text for text in lab.bridge if text.startswith("px4_parameters")]
    missing = [name for name in ("safe", "mocap") if not any(name in text for text in sets)]
    yield _Item(
        "PX4 parameters",
        f"px4.parameters lacks {' and '.join(missing)} (docs/px4.md)" if missing else "",
    )
