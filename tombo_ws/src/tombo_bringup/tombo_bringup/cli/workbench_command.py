"""`tombo workbench`: the propeller in the browser."""

from __future__ import annotations

import typer

from tombo_bringup.cli.options import OwnLibrary, Server, command
from tombo_dynamics.errors import InputError

app = typer.Typer()
PORT = 8361


@command(
    app,
    hidden=True,
    epilog="Exit code: 0 after Ctrl-C; 2 for bad input, or where `make workbench` was not run.",
)
def workbench(own: OwnLibrary, server: Server) -> None:
    """Turn a propeller's knobs in the browser: thrust, torque, deformation, collision force."""
    try:
        from tombo_web.workbench_server import serve_workbench
    except ModuleNotFoundError as error:
        raise InputError(
            f"{error.name} is not installed; accepted: after `make workbench`"
        ) from error
    serve_workbench(own.read(), server.host, PORT if server.port is None else server.port)
