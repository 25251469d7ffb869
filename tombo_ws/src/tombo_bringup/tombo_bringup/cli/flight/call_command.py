"""`tombo call`: ask the running nodes to take off, hold, land, abort or switch the rotors off."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from tombo_bringup.cli.options import integer_option, json_option
from tombo_dynamics.errors import unknown_name

app = typer.Typer()

REQUESTS = ("takeoff", "hold", "land", "abort", "kill")
CALL_EXIT_CODES = "Exit code: 0 when it was obeyed; 1 when it was refused; 2 for bad input."


@app.command(epilog=CALL_EXIT_CODES)
def call(
    request: Annotated[
        str, typer.Argument(metavar="NAME", help="takeoff, hold, land, abort or kill.")
    ],
    domain: Annotated[
        int | None,
        integer_option("--domain N", "ROS_DOMAIN_ID. Default: that of the environment."),
    ] = None,
    as_json: Annotated[bool, json_option("Print the answer as JSON.")] = False,
) -> None:
    """Ask the running nodes (`tombo up`) for one thing, and print what they answer.

    takeoff, hold, land and abort ask the mission; kill switches the rotors off wherever the
    vehicle is. Over PX4 hold, land, abort and kill ask PX4 itself. No installed ROS is needed.
    """
    from tombo_flight.suite.nodes import local_discovery

    if request not in REQUESTS:
        raise unknown_name("request", request, REQUESTS)
    environment = {**os.environ, **local_discovery(os.environ)}
    if domain is not None:
        environment["ROS_DOMAIN_ID"] = str(domain)
    words = ["-m", "tombo_flight.suite.call_node", request, *(["--json"] if as_json else [])]
    sys.stdout.flush()
    os.execve(sys.executable, [sys.executable, *words], environment)
