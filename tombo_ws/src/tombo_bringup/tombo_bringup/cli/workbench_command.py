"""`tombo workbench`: the propeller in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tombo_bringup.cli.options import Host, option
from tombo_dynamics.errors import InputError

app = typer.Typer()


@app.command(
    epilog="Exit code: 0 after Ctrl-C; 2 for bad input, or where `make workbench` was not run."
)
def workbench(
    library: Annotated[
        list[Path] | None,
        option("--library DIR", "Folder with own materials, blades, configurations."),
    ] = None,
    host: Host = "127.0.0.1",
    port: Annotated[int, option("--port P", "0: a free one.", min=0, max=65535)] = 8361,
) -> None:
    """Turn a propeller's knobs in the browser: thrust, torque, deformation, collision force."""
    try:
        from tombo_web.workbench_server import serve_workbench
    except ModuleNotFoundError as error:
        raise InputError(
            f"{error.name} is not installed; accepted: after `make workbench`"
        ) from error
    from tombo_dynamics.propeller import read_library

    serve_workbench(read_library(*(library or ())), host, port)
