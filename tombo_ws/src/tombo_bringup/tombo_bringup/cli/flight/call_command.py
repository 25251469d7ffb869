"""`tombo call`: ask the running nodes to take off, hold, land, abort or switch the rotors off."""

from __future__ import annotations

import re

import typer

from tombo_bringup.cli.flight.graph_commands import become
from tombo_bringup.cli.options import Domain, Shown, argument, command, option, record
from tombo_dynamics.errors import InputError, unknown_name

app = typer.Typer()

REQUESTS = ("takeoff", "hold", "land", "abort", "kill")
CALL_EXIT_CODES = "Exit code: 0 when it was obeyed; 1 when it was refused; 2 for bad input."


def _namespace(name: str | None) -> str | None:
    if name is not None and not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
        raise InputError(f"--vehicle '{name}': not a namespace; accepted: a name such as v1")
    return name


@record
class _Request:
    request: str = argument("NAME", "takeoff, hold, land, abort or kill.")
    vehicle: str | None = option(
        "--vehicle V1", "One vehicle of `tombo up --vehicles`: its namespace.", check=_namespace
    )


@command(app, epilog=CALL_EXIT_CODES)
def call(given: _Request, domain: Domain, shown: Shown) -> None:
    """Ask the running nodes (`tombo up`) for one thing, and print what they answer.

    takeoff, hold, land and abort ask the mission; kill switches the rotors off wherever the
    vehicle is. Over PX4 hold, land, abort and kill ask PX4 itself. No installed ROS is needed.

    Beside it: `tombo topic list|echo|hz` and `tombo param list|get|set|dump`.
    """
    request = given.request
    if request not in REQUESTS:
        raise unknown_name("request", request, REQUESTS)
    become(("call", request, given.vehicle or "/"), domain, shown)
