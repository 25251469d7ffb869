"""Options that several commands have, and how their texts are read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer


def parse_integer(text: object) -> int:
    """Return the whole number that an option's text means, for typer's `parser`.

    Raises:
        typer.BadParameter: it is none.
    """
    try:
        return int(str(text))
    except ValueError:
        raise typer.BadParameter(f"'{text}' is not a whole number") from None


def number_parser(
    accepted: str | Callable[[], str], kind: type[float] = float
) -> Callable[[object], Any]:
    """Return a `parser` for typer: the number that an option's text means.

    Args:
        accepted: what is accepted, or a function that returns it: called only for bad text.
        kind: float or int.
    """

    def number(text: object) -> Any:
        try:
            return kind(str(text))
        except ValueError:
            words = accepted if isinstance(accepted, str) else accepted()
            raise typer.BadParameter(f"'{text}'; accepted: {words}") from None

    return number


def integer_option(name: str, metavar: str, text: str, *, show_default: bool = True) -> Any:
    """Return an option that is a whole number."""
    return typer.Option(
        name, metavar=metavar, parser=parse_integer, help=text, show_default=show_default
    )


def json_option(text: str) -> Any:
    """Return the option --json."""
    return typer.Option("--json", help=text)


def output_option(text: str) -> Any:
    """Return the option -o, a folder of results."""
    return typer.Option("-o", "--output", metavar="DIR", help=text)


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
Seed = Annotated[int, integer_option("--seed", "N", "All chance comes from it.")]
Yes = Annotated[bool, typer.Option("--yes", help="With --px4 URL: arm without asking first.")]
Duration = Annotated[
    float | None, typer.Option("--duration", metavar="S", help="Stop after S seconds.")
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Replace the results in DIR; other files in it are left alone."),
]
JsonOnly = Annotated[bool, json_option("Print JSON only.")]
