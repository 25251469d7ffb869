"""Options that several commands have, and how their texts are read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from tombo_dynamics.errors import InputError


def number_option(
    name: str,
    metavar: str,
    text: str,
    accepted: str | Callable[[], str],
    kind: type[float] = float,
) -> Any:
    """Return an option that is a number.

    Args:
        name: with its dashes.
        metavar: of the help: its unit.
        text: of the help.
        accepted: what the error names when the text is no number; or a function that returns it.
        kind: float or int.
    """

    def parse(given: object) -> float:
        try:
            return kind(str(given))
        except ValueError:
            words = accepted if isinstance(accepted, str) else accepted()
            raise typer.BadParameter(f"'{given}'; accepted: {words}") from None

    return typer.Option(name, metavar=metavar, parser=parse, help=text)


def integer_option(
    name: str,
    metavar: str,
    text: str,
    *,
    show_default: bool = True,
    callback: Callable[..., Any] | None = None,
) -> Any:
    """Return an option that is a whole number; `callback` checks it."""

    def parse(given: object) -> int:
        try:
            return int(str(given))
        except ValueError:
            raise typer.BadParameter(f"'{given}' is not a whole number") from None

    return typer.Option(
        name,
        metavar=metavar,
        parser=parse,
        help=text,
        show_default=show_default,
        callback=callback,
    )


def json_option(text: str) -> Any:
    """Return the option --json."""
    return typer.Option("--json", help=text)


def output_option(text: str) -> Any:
    """Return the option -o, a folder of results."""
    return typer.Option("-o", "--output", metavar="DIR", help=text)


def _check_seed(seed: int | None) -> int | None:
    if seed is not None and not 0 <= seed < SEED_LIMIT:
        raise InputError(
            f"--seed {seed}: out of bounds; accepted: a whole number from 0 to {SEED_LIMIT - 1}"
        )
    return seed


def _check_duration(duration: float | None) -> float | None:
    if duration is not None and not duration > 0.0:
        raise InputError(f"--duration {duration:g}: out of bounds; accepted: a number above 0")
    return duration


SEED_LIMIT = 2**63
_SCENARIO = "A name of `tombo scenarios`, or a YAML file."
ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help=_SCENARIO, show_default=True)
]
ScenarioOption = Annotated[str, typer.Option("--scenario", metavar="SCENARIO", help=_SCENARIO)]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value of the scenario, as in vehicle.mass=1.4 or "
        "effects.steady_wind.east=2. May be given many times.",
    ),
]
ModelFile = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="FILE",
        help="Lay the effects of a model.yaml, which `tombo diagnose` writes, over those of "
        "the scenario; --set wins over both.",
    ),
]
_SEED = "All random draws come from it."
Seed = Annotated[int, integer_option("--seed", "N", _SEED, callback=_check_seed)]
SeedOrNone = Annotated[
    int | None, integer_option("--seed", "N", f"{_SEED} Default: 0.", callback=_check_seed)
]
Yes = Annotated[bool, typer.Option("--yes", help="With --px4 URL: arm without asking first.")]
BridgeSettings = Annotated[
    list[str] | None,
    typer.Option(
        "--bridge",
        metavar="KEY=VALUE",
        help="With --px4: set a parameter of the bridge, as in link.allow_remote=true, "
        "px4.position_std=0.002 or, of PX4 itself, px4_parameters=[EKF2_EV_CTRL=11]. May be "
        "given many times.",
    ),
]
Duration = Annotated[
    float | None,
    typer.Option(
        "--duration", metavar="S", help="Stop after S seconds.", callback=_check_duration
    ),
]
Px4Url = Annotated[
    str | None,
    typer.Option(
        "--px4",
        metavar="[URL]",
        help="Fly with the nodes over MAVLink: a simulated PX4, or the one at URL (udpin://, "
        "udpout://, tcpout://, serial://), which may be a real vehicle.",
    ),
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Replace the results in DIR; other files in it are left alone."),
]
JsonOnly = Annotated[bool, json_option("Print JSON only.")]
