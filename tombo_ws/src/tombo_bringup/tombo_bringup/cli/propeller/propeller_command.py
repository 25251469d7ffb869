"""`tombo propeller`: operating points of a propeller as table or JSON."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import command, option, record
from tombo_bringup.cli.propeller.design_command import design
from tombo_bringup.cli.propeller.diagnose_command import diagnose
from tombo_bringup.cli.propeller.recovery_command import recovery
from tombo_bringup.cli.propeller.reproduce_command import reproduce
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_dynamics.propeller import Configuration, Operation
    from tombo_flight.report.page import Page

app = typer.Typer(
    name="propeller",
    help="The propeller model: thrust, drag, torque, deformation.",
    context_settings=options.HELP_OPTIONS,
)

_MOST_ROWS = 100_000
_ANGLES = ("alpha_rad", "beta_rad", "gamma_rad")
_FIELDS = ("thrust_N", "drag_N", "torque_Nm", *_ANGLES, "lift_over_drag")
_HEADINGS = (
    *("rpm", "thrust N", "drag N", "torque mN m"),
    *("alpha deg", "beta deg", "gamma deg", "L/D", "valid"),
)
_RPM = 30.0 / math.pi


@record
class _Points:
    rpm: str | None = option("--rpm A:B:STEP", "Both ends included; or one speed. Default: all.")


def propeller(
    ctx: typer.Context,
    which: options.Propeller,
    own: options.OwnLibrary,
    given: _Points,
    shown: options.Shown,
) -> None:
    """Print the operating points of a propeller: by default configuration 13, law repaired.

    Curves over speed: tombo workbench.

    Speeds of a range at which the law is not valid come out as valid = false and empty. A range
    without a valid speed is an error.
    """
    if ctx.invoked_subcommand is not None:
        if any(
            map(options.is_given, (*vars(which).values(), own.library, given.rpm, shown.as_json))
        ):
            raise InputError(
                f"options before {ctx.invoked_subcommand} have no effect; accepted: behind it"
            )
        return
    from tombo_dynamics.propeller import evaluate, valid_speed

    conf = 13 if which.conf is None else which.conf
    law = "repaired" if which.law is None else which.law
    chosen = own.read().configuration(conf)
    limit = valid_speed(chosen, law) * _RPM
    speeds = _default_speeds(limit) if given.rpm is None else parse_rpm(given.rpm)
    radians = [speed / _RPM for speed in speeds]
    points = evaluate(chosen, radians, law, outside="mask")
    if not points.valid.any():
        evaluate(chosen, radians, law)  # says which range is valid
    if shown.as_json:
        typer.echo(json.dumps(rows(points, speeds, conf, law), indent=1))
    else:
        from tombo_bringup.cli.tables import show_page

        show_page(_page(points, speeds, chosen, law, limit), False)


def parse_rpm(text: str) -> list[float]:
    """Return the speeds [rpm] that `A:B:STEP`, `A:B` (step 500) or `A` means, ends included.

    Raises:
        InputError: not of this form, beyond the highest speed of the model, or too many speeds.
    """
    from tombo_dynamics.propeller import SPEED_LIMIT

    top = SPEED_LIMIT * _RPM
    parts = text.split(":")
    try:
        first, last, step = map(float, [*parts, *[parts[0], "500"][len(parts) - 1 :]])
    except ValueError:
        first = last = step = math.nan
    in_range = 0.0 <= first <= last <= top * (1.0 + 1e-12)
    if not (in_range and step > 0.0 and (last - first) / step < _MOST_ROWS):
        raise InputError(
            f"--rpm {text}: accepted: A:B:STEP or A, 0 <= A <= B <= {top:.0f} rpm, STEP above 0, "
            f"at most {_MOST_ROWS} speeds"
        )
    count = math.floor((last - first) / step + 1e-9) + 1
    return [min(first + i * step, last) for i in range(count)]


def rows(points: Operation, speeds: list[float], conf: int, law: str) -> list[dict[str, Any]]:
    """Return one JSON object a speed; SI units and radians, null where the law is not valid."""
    return [
        {
            "law": law,
            "conf": conf,
            "rpm": speed,
            **{n: float(getattr(points, n)[i]) if points.valid[i] else None for n in _FIELDS},
            "valid": bool(points.valid[i]),
        }
        for i, speed in enumerate(speeds)
    ]


def _default_speeds(limit: float) -> list[float]:
    step = 500.0 if limit < 9000.0 else 1000.0
    return [step * i for i in range(1, math.floor(limit / step + 1e-9) + 1)]


def _page(
    points: Operation, speeds: list[float], chosen: Configuration, law: str, limit: float
) -> Page:
    from tombo_dynamics.propeller import speed_of_maximum_thrust
    from tombo_flight.report.page import Cell, Page, Section, Table, Text

    table: list[list[str | Cell]] = []
    for i, speed in enumerate(speeds):
        if not points.valid[i]:
            table.append([f"{speed:g}", *7 * ["-"], Cell("no", "bad")])
            continue
        table.append(
            [
                f"{speed:g}",
                f"{points.thrust_N[i]:.3f}",
                f"{points.drag_N[i]:.3f}",
                f"{points.torque_Nm[i] * 1e3:.1f}",
                *(f"{math.degrees(getattr(points, name)[i]):.2f}" for name in _ANGLES),
                f"{points.lift_over_drag[i]:.4f}",
                Cell("yes", "good"),
            ]
        )
    top, exists = speed_of_maximum_thrust(chosen, law)
    most = f"Maximum of thrust at {top * _RPM:.0f} rpm." if exists else "No maximum of thrust."
    lines = [f"Valid up to {limit:.0f} rpm. {most}"]
    if chosen.measured is not None:
        lines.append(
            f"Measured at 2000 rpm (Table III): {chosen.measured.thrust_N:.3f} "
            f"+- {chosen.measured.thrust_dev_N:.2f} N."
        )
    return Page(
        title="Operating points",
        eyebrow="Tombo propeller",
        headline=f"Conf. {chosen.number}{', rigid' if chosen.rigid else ''}, law {law}",
        summary="",
        sections=[Section("", [Table(_HEADINGS, table), Text(lines)])],
    )


app.callback(invoke_without_command=True)(options.spelt_out(propeller))
for _command in (design, reproduce, diagnose, recovery):
    command(app)(_command)
