"""Options of commands, as records of the things that they set.

A command takes records, and `command` makes them options of typer. An option is defined once: here
if several commands have it, else in the file of its command.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    TypeVar,
    dataclass_transform,
    get_args,
    get_type_hints,
)

import typer
from typer.core import TyperCommand

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_seed

if TYPE_CHECKING:
    from tombo_dynamics.propeller import Library

HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}
"""Settings of a group of commands."""
_MISSING = dataclasses.MISSING
_Record = TypeVar("_Record")


@dataclass_transform(kw_only_default=True, frozen_default=True)
def record(cls: type[_Record]) -> type[_Record]:
    """Make a class a record of options."""
    return dataclass(frozen=True, kw_only=True)(cls)


def option(
    declaration: str,
    text: str,
    default: Any = None,
    *,
    bounds: tuple[float, float] | None = None,
    check: Callable[..., Any] | None = None,
    **more: Any,
) -> Any:
    """Declare a field of a record that is set by an option.

    Args:
        declaration: names, and the placeholder of its value in the help, as in "-o/--output DIR".
        text: of the help.
        default: where the option is not given; `...`: it must be given.
        bounds: lowest and highest number.
        check: takes the value and returns it, or raises InputError.
        more: further arguments of `typer.Option`.
    """
    names, _, metavar = declaration.partition(" ")
    flag = names.split("/")[-1]
    if bounds is not None:
        check = _within(flag, *bounds)
    if check is not None:
        more["callback"] = check
    info = typer.Option(*names.split("/"), metavar=metavar or None, help=text, **more)
    return _field(default, info)


def argument(metavar: str, text: str, default: Any = ..., **more: Any) -> Any:
    """Declare a field of a record that is set by an argument; others as of `option`."""
    return _field(default, typer.Argument(metavar=metavar, help=text, **more))


def command(
    app: typer.Typer,
    name: str | None = None,
    *,
    lab: bool = False,
    expand: Callable[[list[str]], list[str]] | None = None,
    **settings: Any,
) -> Callable[..., Any]:
    """Return what makes a function a command of `app`, under its own name or another.

    Parameters of the function are records of options, or `typer.Context`; its description is shown
    with a line a paragraph.

    Args:
        app: gets the command.
        name: of the command.
        lab: it takes a lab file, whose values stand where the command line has none.
        expand: changes the words of a command line before typer reads them.
        settings: further ones of the command.
    """

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        text = inspect.cleandoc(function.__doc__ or "").split("\n\n")
        settings.setdefault("help", "\n\n".join(" ".join(part.split()) for part in text))
        if expand is not None:
            settings["cls"] = type("ExpandingCommand", (_ExpandingCommand,), {"expand": expand})
        app.command(name, **settings)(spelt_out(function, lab=lab))
        return function

    return register


class _ExpandingCommand(TyperCommand):
    expand: Callable[[list[str]], list[str]]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, type(self).expand(args))


_LAB = inspect.Parameter(
    "lab",
    inspect.Parameter.KEYWORD_ONLY,
    default=None,
    annotation=Annotated[
        str | None,
        typer.Option(
            "--lab",
            metavar="FILE",
            envvar="TOMBO_LAB",
            help="A lab file (`tombo lab`), whose settings come before those given here.",
        ),
    ],
)


def spelt_out(function: Callable[..., Any], *, lab: bool = False) -> Callable[..., Any]:
    """Return a function with an argument for each option, as typer reads it.

    Args:
        function: each parameter is a record of options, or anything that typer knows.
        lab: there is the option `--lab`, too.
    """
    records: dict[str, type[Any]] = {}
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(function, eval_str=True).parameters.values():
        kind = parameter.annotation
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            records[parameter.name] = kind
            parameters += _parameters(kind)
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    if lab:
        parameters.append(_LAB)

    @functools.wraps(function)
    def call(**given: Any) -> Any:
        if file := given.pop(_LAB.name, None):
            from tombo_bringup.lab_file import read_lab

            given = read_lab(Path(file)).merged(given)
        made = {
            name: kind(**{f.name: given.pop(f.name) for f in _options(kind)})
            for name, kind in records.items()
        }
        return function(**made, **given)

    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {p.name: p.annotation for p in parameters}
    return call


def _field(default: Any, info: Any) -> Any:
    default = _MISSING if default is ... else default
    return dataclasses.field(default=default, metadata={"option": info})


def _options(record: type[Any]) -> list[dataclasses.Field[Any]]:
    """Return the fields of a record that are set by options, and its numbers (`param`)."""
    kinds = ("option", "bounds")
    return [f for f in dataclasses.fields(record) if any(kind in f.metadata for kind in kinds)]


def _parameters(record: type[Any]) -> list[inspect.Parameter]:
    """Return a parameter of a function for each option of a record."""
    hints, made = get_type_hints(record), []
    for field in _options(record):
        hint, meta = hints[field.name], field.metadata
        info = meta.get("option")
        if info is None:  # the record checks the number itself
            unit = meta["unit"]
            flag = f"--{field.name.removesuffix(f'_{unit}').replace('_', '-')}"
            info = typer.Option(
                flag, metavar="X" if unit == "1" else unit.upper(), help=meta["doc"]
            )
        for kind in (int, float):
            if hint is kind or kind in get_args(hint):
                info.parser = functools.partial(_number, kind)
        missing = field.default is _MISSING
        made.append(
            inspect.Parameter(
                field.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if missing else field.default,
                annotation=Annotated[hint, info],
            )
        )
    return made


def _number(kind: type[float], given: object) -> float:
    try:
        return kind(str(given))
    except ValueError:
        what = "a whole number" if kind is int else "a number"
        raise typer.BadParameter(f"'{given}'; accepted: {what}") from None


def _within(flag: str, low: float, high: float) -> Callable[[Any], Any]:
    def check(value: Any) -> Any:
        if value is not None and not low <= value <= high:
            raise InputError(f"{flag} {value:g}: out of bounds; accepted: {low:g} to {high:g}")
        return value

    return check


def topic_names(texts: Sequence[str]) -> dict[str, str]:
    """Return recorded topic -> the suite's name, from RECORDED:=NAME or RECORDED=NAME.

    Raises:
        InputError: not of this form, or a topic given twice.
    """
    names: dict[str, str] = {}
    for text in texts:
        source, sign, name = text.partition("=")
        source = source.removesuffix(":").strip()
        if not sign or not source or not name.strip():
            raise InputError(f"--map {text}: accepted: TOPIC:=NAME, as in /lab/pose:=/mocap/pose")
        if source in names:
            raise InputError(f"--map {text}: {source} is given twice; accepted: once")
        names[source] = name.strip()
    return names


def _seed(seed: int | None) -> int | None:
    return None if seed is None else check_seed("--seed", seed)


def _import(files: list[str] | None) -> list[str] | None:
    if files:
        from tombo_flight.own_files import import_files

        import_files(files)
    return files


def _output(output: str | None) -> str | None:
    if output is not None and not output.strip():
        raise InputError(f"-o '{output}': no name; accepted: a folder, new or empty")
    return output


@record
class Scene:
    """The scenario."""

    scenario: str = argument(
        "SCENARIO", "A name of `tombo list scenarios`, or a YAML file.", "paper_collision",
    )  # fmt: skip


@record
class Settings:
    """Single values that are set."""

    settings: list[str] | None = option(
        "--set KEY=VALUE",
        "Change a value, as in vehicle.mass=1.4 or effects.steady_wind.east=2. May be given many "
        "times.",
    )


@record
class Imports:
    """Code of one's own."""

    imports: list[str] | None = option(
        "--import FILE",
        "A Python file with effects, reactions or cores of your own (docs/own_collision.md). May "
        "be given many times.",
        check=_import,
        is_eager=True,
    )


@record
class VehicleName:
    """The vehicle."""

    vehicle: str | None = option(
        "--vehicle NAME|FILE",
        "A name of `tombo vehicle list`, or a vehicle file (docs/own_vehicle.md). Default: that "
        "of the scenario or the log, else the suite's own.",
    )


@record
class ModelFile:
    """The model that an earlier diagnosis found."""

    model: str | None = option(
        "--model FILE",
        "A model file that `tombo diagnose` or `tombo propeller diagnose` has written. Its "
        "effects are merged with those of the scenario; --set wins over both.",
    )


@record
class Variation(Imports, Settings, ModelFile, VehicleName):
    """Changes of a scenario."""

    reaction: str | None = option(
        "--reaction NAME",
        "A name of `tombo list reactions`, in place of the scenario's reaction; its parameters: "
        "--set reaction.KEY=VALUE.",
    )
    disturbances: bool = option(
        "--disturbances",
        "With what clean figures leave out: wind, vibration, a real IMU, scatter, battery "
        "(docs/reactions.md); --set wins over each.",
        False,
    )

    @property
    def changes(self) -> list[str]:
        """The settings that the options mean; those of --set come last.

        Raises:
            InputError: the reaction is unknown.
        """
        from tombo_collision.reactions import REGISTRY

        if self.reaction is not None and self.reaction not in REGISTRY:
            raise unknown_name("--reaction", self.reaction, REGISTRY)
        named = [] if self.reaction is None else [f"reaction.name={self.reaction}"]
        over = ["disturbances=true"] if self.disturbances else []
        return [*over, *named, *(self.settings or [])]


@record
class Draw:
    """Random draws."""

    seed: int | None = option(
        "--seed N", "All random draws come from it. Default: 0.", check=_seed
    )


@record
class Seeds:
    """Many random draws."""

    seeds: str | None = option(
        "--seeds A:B", "Fly seeds A to B-1 on all cores; one table, no files of single flights."
    )


@record
class Duration:
    """When a command ends by itself."""

    duration: float | None = option("--duration S", "Stop after S seconds.", bounds=(1e-3, 1e9))


@record
class Pace:
    """How fast time goes."""

    speed: float | None = option(
        "--speed X", "Simulated or recorded time against real time. Default: 1."
    )


@record
class Domain:
    """Where the nodes are."""

    domain: int | None = option(
        "--domain N",
        "ROS_DOMAIN_ID. Default: that of the environment; of a simulated flight one that is free.",
    )


@record
class Law:
    """The law of a nodus."""

    law: str | None = option("--law L", "Law of the nodus: published, repaired or consistent.")


@record
class Propeller(Law):
    """A propeller of the paper."""

    conf: int | None = option(
        "--conf N", "Configuration of the paper's Table I, 0 (rigid) to 13, or of a --library."
    )


@record
class OwnLibrary:
    """Propellers of one's own."""

    library: list[Path] | None = option(
        "--library DIR",
        "Folder with any of materials.yaml, blades.yaml, configurations.yaml, measurements.yaml "
        "of your own. May be given many times.",
    )

    def read(self) -> Library:
        """Return the built-in library with the content of the folders.

        Raises:
            InputError: a folder can't be used.
        """
        from tombo_dynamics.propeller import read_library

        for folder in self.library or ():
            if not folder.is_dir():
                raise InputError(
                    f"--library {folder}: no such folder; accepted: a folder with any of "
                    "materials.yaml, blades.yaml, configurations.yaml, measurements.yaml"
                )
        return read_library(*(self.library or ()))


@record
class Logs:
    """Measured flights."""

    logs: list[Path] = argument(
        "LOG...", "Flights of one vehicle: MCAP, rosbag2 folder, ROS 1 bag, PX4 ULog, CSV."
    )


@record
class LogMapping:
    """Columns of a log."""

    mapping: str | None = option(
        "--mapping FILE|NAME",
        "What the columns of a CSV are, in which units and frames (docs/logs.md, docs/stand.md).",
    )


@record
class Topics:
    """Topics of a recording."""

    maps: list[str] | None = option(
        "--map TOPIC:=NAME",
        "Take a recorded topic for one of the suite's, as in /lab/pose:=/mocap/pose. May be "
        "given many times.",
    )

    @property
    def names(self) -> dict[str, str]:
        """Recorded topic -> the suite's name."""
        return topic_names(self.maps or [])


@record
class Reading(LogMapping, Topics):
    """Columns and topics of a log."""


@record
class Server:
    """Where a page is served."""

    host: str = option(
        "--host ADDRESS", "Address to serve at; others than 127.0.0.1 need the token.", "127.0.0.1"
    )
    port: int | None = option(
        "--port P", "0: a free one. Default: 8360, of the workbench 8361.", bounds=(0, 65535)
    )


@record
class Workers:
    """Processes."""

    workers: int | None = option(
        "--workers N", "Processes on this machine. Default: one for each core.", bounds=(1, 1024)
    )


@record
class Force:
    """Whether anything may be replaced."""

    force: bool = option(
        "--force", "Replace the results that are there; other files are left alone.", False
    )


@record
class Shown:
    """How results are printed."""

    as_json: bool = option("--json", "Print the results as JSON, and nothing else.", False)


@record
class Copies(Shown):
    """Where results go."""

    output: str | None = option(
        "-o/--output DIR",
        "Folder of the results, new or empty; in its own, a stopped sweep goes on. Default: a new "
        "one in runs/; none where it is said that -o writes, or with --json.",
        check=_output,
    )


@record
class Results(Force, Copies):
    """Where results go, and whether they may be replaced."""


Rule = tuple[str, Sequence[str], Sequence[str]]
"""An option, options of which it needs one, and options that exclude it."""


def is_given(value: Any) -> bool:
    """Return whether an option is given: zero is a value, False and an empty list are none."""
    return value is not None and value is not False and value != []


def check_options(rules: Sequence[Rule], given: Mapping[str, Any]) -> None:
    """Refuse options that don't go together, by the first rule that they break.

    Args:
        rules: of the command, by names of parameters.
        given: name of a parameter -> its value.

    Raises:
        InputError: there are some.
    """
    for name, needs, without in rules:
        lacks = needs and not any(is_given(given[other]) for other in needs)
        if is_given(given[name]) and (lacks or any(is_given(given[other]) for other in without)):
            parts = [f"with {_flags(needs, 'or')}"] if needs else []
            parts += [f"without {_flags(without, 'and')}"] if without else []
            raise InputError(f"--{name.replace('_', '-')}: accepted: {' and '.join(parts)}")


def _flags(names: Sequence[str], last: str) -> str:
    flags = [f"--{name.replace('_', '-')}" for name in names]
    return f" {last} ".join([", ".join(flags[:-1]), flags[-1]] if len(flags) > 1 else flags)
