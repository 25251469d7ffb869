"""Options that several commands have, how their texts are read, and which go together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from tombo_dynamics.errors import InputError
from tombo_dynamics.params import check_seed

HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}
"""Settings of a group of commands."""


def option(declaration: str, text: str, **more: Any) -> Any:
    """Return an option.

    Args:
        declaration: name, and what stands for its value in the help, as in "--set KEY=VALUE".
        text: of the help.
        more: further arguments of `typer.Option`.
    """
    name, _, metavar = declaration.partition(" ")
    return typer.Option(name, metavar=metavar or None, help=text, **more)


def number_option(
    declaration: str,
    text: str,
    accepted: str | Callable[[], str],
    kind: type[float] = float,
    **more: Any,
) -> Any:
    """Return an option that is a number, of a `kind`: float or int.

    `accepted` is what the error names when the text is no number, or a function that returns it.
    """

    def complaint() -> str:
        return f"; accepted: {accepted if isinstance(accepted, str) else accepted()}"

    return option(declaration, text, parser=_parser(kind, complaint), **more)


def integer_option(declaration: str, text: str, **more: Any) -> Any:
    """Return an option that is a whole number, with further arguments of `typer.Option`."""
    return option(declaration, text, parser=_parser(int, lambda: " is not a whole number"), **more)


def former_option(declaration: str, now: str) -> Any:
    """Return an option that goes by another name now: it is not listed, but obeyed with a word."""
    name = declaration.partition(" ")[0]

    def say(value: Any) -> Any:
        if value:
            typer.echo(f"{name} is now {now}", err=True)
        return value

    return option(declaration, f"Now {now}.", hidden=True, callback=say)


def json_option(text: str) -> Any:
    """Return the option --json."""
    return option("--json", text)


def output_option(text: str) -> Any:
    """Return the option -o, a folder of results."""
    return typer.Option("-o", "--output", metavar="DIR", help=text)


def _parser(kind: type[float], complaint: Callable[[], str]) -> Callable[[object], float]:
    def parse(given: object) -> float:
        try:
            return kind(str(given))
        except ValueError:
            raise typer.BadParameter(f"'{given}'{complaint()}") from None

    return parse


def _let_unpack(ctx: typer.Context, limit_gb: float | None) -> float | None:
    """Set the limit until the command ends."""
    from tombo_bag.formats.unpacking import GIGABYTE, unpacking_up_to

    if limit_gb is not None and not 0.0 < limit_gb < 1e6:
        raise InputError(f"--unpack-limit {limit_gb:g}: out of bounds; accepted: a number above 0")
    limit = None if limit_gb is None else int(limit_gb * GIGABYTE)
    ctx.with_resource(unpacking_up_to(limit))
    return limit_gb


def _check_seed(seed: int | None) -> int | None:
    return None if seed is None else check_seed("--seed", seed)


def _import(files: list[str] | None) -> list[str] | None:
    if files:
        from tombo_flight.own_files import import_files

        import_files(files)
    return files


def _check_duration(duration: float | None) -> float | None:
    if duration is not None and not duration > 0.0:
        raise InputError(f"--duration {duration:g}: out of bounds; accepted: a number above 0")
    return duration


def topic_names(option_name: str, texts: Sequence[str]) -> dict[str, str]:
    """Return recorded topic -> the suite's name, from RECORDED:=NAME or RECORDED=NAME.

    Raises:
        InputError: not of this form, or a topic given twice.
    """
    names: dict[str, str] = {}
    for text in texts:
        source, sign, name = text.partition("=")
        source = source.removesuffix(":").strip()
        if not sign or not source or not name.strip():
            raise InputError(
                f"{option_name} {text}: accepted: TOPIC:=NAME, as in /lab/pose:=/mocap/pose"
            )
        if source in names:
            raise InputError(f"{option_name} {text}: {source} is given twice; accepted: once")
        names[source] = name.strip()
    return names


def _check_workers(workers: int | None) -> int | None:
    if workers is not None and not 1 <= workers <= _MOST_WORKERS:
        raise InputError(f"--workers {workers}: out of bounds; accepted: 1 to {_MOST_WORKERS}")
    return workers


def _scenarios(begun: str) -> list[tuple[str, str]]:
    """Return what the shell may complete: the scenarios that begin so."""
    from tombo_flight.scenario_catalogue import builtin_scenarios

    return _completions(builtin_scenarios(), begun)


def _vehicles(begun: str) -> list[tuple[str, str]]:
    from tombo_flight.vehicle_file import builtin_vehicles

    return _completions(builtin_vehicles(), begun)


def _reactions(begun: str) -> list[tuple[str, str]]:
    from tombo_collision.reactions import REGISTRY

    return _completions(dict.fromkeys(REGISTRY, ""), begun)


def _completions(table: Mapping[str, str], begun: str) -> list[tuple[str, str]]:
    return [(name, text) for name, text in table.items() if name.startswith(begun)]


@dataclass(frozen=True)
class OptionRule:
    """What one option needs beside it, and what it can't be combined with."""

    shown: str
    """The option in a message; a name of a parameter in braces stands for its value."""
    option: str
    """Name of its parameter."""
    needs: tuple[str, ...] = ()
    """Options, one of which must be given."""
    without: tuple[str, ...] = ()
    """Options, none of which may be given."""
    accepted: str = ""
    """What is accepted, in words; empty: it follows from `needs` and `without`."""

    def check(self, given: Mapping[str, Any]) -> None:
        """Refuse a combination.

        Raises:
            InputError: the rule is broken.
        """
        if not is_given(given[self.option]):
            return
        lacks = self.needs and not any(is_given(given[name]) for name in self.needs)
        if lacks or any(is_given(given[name]) for name in self.without):
            accepted = self.accepted or self._words()
            raise InputError(f"{self.shown.format_map(given)}: accepted: {accepted}")

    def _words(self) -> str:
        parts = []
        if self.needs:
            parts.append(f"with {_flags(self.needs, 'or')}{'' if self.without else ' only'}")
        if self.without:
            parts.append(f"without {_flags(self.without, 'and')}")
        return " and ".join(parts)


def is_given(value: Any) -> bool:
    """Return whether an option is given: zero is a value, False and an empty list are none."""
    return value is not None and value is not False and value != []


def check_options(rules: Sequence[OptionRule], given: Mapping[str, Any]) -> None:
    """Refuse options that don't go together, by the first rule that they break.

    Args:
        rules: of the command.
        given: name of a parameter → its value.

    Raises:
        InputError: there are some.
    """
    for rule in rules:
        rule.check(given)


def _flags(names: Sequence[str], last: str) -> str:
    flags = [f"--{name.replace('_', '-')}" for name in names]
    return f" {last} ".join([", ".join(flags[:-1]), flags[-1]] if len(flags) > 1 else flags)


_MOST_WORKERS = 1024
_SCENARIO = "A name of `tombo scenarios`, or a YAML file."
ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO", help=_SCENARIO, show_default=True, autocompletion=_scenarios
    ),
]
FormerScenario = Annotated[
    str | None, former_option("--scenario SCENARIO", "the argument SCENARIO")
]
Settings = Annotated[
    list[str] | None,
    option(
        "--set KEY=VALUE",
        "Change a value of the scenario, as in vehicle.mass=1.4 or effects.steady_wind.east=2. "
        "May be given many times.",
    ),
]
ReactionName = Annotated[
    str | None,
    option(
        "--reaction NAME",
        "A name of `tombo reactions`, in place of the scenario's reaction; its parameters: "
        "--set reaction.KEY=VALUE.",
        autocompletion=_reactions,
    ),
]
Imports = Annotated[
    list[str] | None,
    option(
        "--import FILE",
        "A Python file with effects, reactions or cores of your own (docs/own_collision.md). May "
        "be given many times.",
        callback=_import,
        is_eager=True,
    ),
]
Disturbed = Annotated[
    bool,
    option(
        "--disturbances",
        "With what clean figures leave out: wind, vibration, a real IMU, scatter, battery "
        "(docs/reactions.md); --set wins over each.",
    ),
]
ModelFile = Annotated[
    str | None,
    option(
        "--model FILE",
        "Lay the effects of a model.yaml, which `tombo diagnose` writes, over those of the "
        "scenario; --set wins over both.",
    ),
]
VehicleName = Annotated[
    str | None,
    option(
        "--vehicle NAME|FILE",
        "A name of `tombo vehicle list`, or a vehicle file (docs/own_vehicle.md), in place of the "
        "scenario's vehicle, propeller and gains; --set wins over it.",
        autocompletion=_vehicles,
    ),
]
_SEED = "All random draws come from it."
Seed = Annotated[int, integer_option("--seed N", _SEED, callback=_check_seed)]
SeedOrNone = Annotated[
    int | None, integer_option("--seed N", f"{_SEED} Default: 0.", callback=_check_seed)
]
Yes = Annotated[bool, option("--yes", "With --px4 URL: arm without asking first.")]
BridgeSettings = Annotated[
    list[str] | None,
    option(
        "--bridge KEY=VALUE",
        "With --px4: set a parameter of the bridge, as in link.allow_remote=true, "
        "px4.position_std=0.002 or, of PX4 itself, px4_parameters=[EKF2_EV_CTRL=11]; "
        "px4_parameters=safe: those with which a loss ends on the ground. May be given many "
        "times.",
    ),
]
Duration = Annotated[
    float | None, option("--duration S", "Stop after S seconds.", callback=_check_duration)
]
Px4Url = Annotated[
    str | None,
    option(
        "--px4 [URL]",
        "Fly with the nodes over MAVLink: a simulated PX4, or the one at URL (udpin://, "
        "udpout://, tcpout://, serial://), which may be a real vehicle.",
    ),
]
Force = Annotated[
    bool, option("--force", "Replace the results in DIR; other files in it are left alone.")
]
LogMapping = Annotated[
    str | None,
    option(
        "--mapping FILE|NAME",
        "What the columns of a CSV are, in which units and frames (docs/logs.md).",
    ),
]
Host = Annotated[
    str, option("--host ADDRESS", "Address to serve at; others than 127.0.0.1 need the token.")
]
TopicNames = Annotated[
    list[str] | None,
    option(
        "--map TOPIC:=NAME",
        "Take a recorded topic for one of the suite's, as in /lab/pose:=/mocap/pose. May be "
        "given many times.",
    ),
]
Workers = Annotated[
    int | None,
    integer_option(
        "--workers N",
        "Processes on this machine. Default: one for each core.",
        callback=_check_workers,
    ),
]
JsonOnly = Annotated[bool, json_option("Print JSON only.")]
UnpackLimit = Annotated[
    float | None,
    number_option(
        "--unpack-limit GB",
        "Unpack a compressed file to this size at most. Default: 100 times the size of the file, "
        "and a quarter of the machine's memory.",
        "a number of gigabytes",
        callback=_let_unpack,
    ),
]
