"""`tombo live`: a flight in the browser while it happens, or played back."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import argument, command, option, record
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

app = typer.Typer()

LIVE_EXIT_CODES = "Exit code: 0 after Ctrl-C; 2 for bad input, or where `make live` was not run."
SUITE = "suite"
PORT = 8360
NICENESS = 10
"""Of the page of running nodes, from its first import on: their loops come first."""


@record
class _Source:
    source: str = argument(
        "[SOURCE]",
        "suite: running nodes, also over PX4, and a lab's own topics. A recording or another log. "
        "A scenario, which is flown headless first.",
        SUITE,
    )
    foxglove: int | None = option(
        "--foxglove PORT", "Serve the same messages to Foxglove too.", bounds=(1, 65535)
    )


@command(app, epilog=LIVE_EXIT_CODES)
def live(
    given: _Source,
    draw: options.Draw,
    reading: options.Reading,
    pace: options.Pace,
    server: options.Server,
) -> None:
    """Show a flight in the browser: 3-D scene, curves, states, faults; pause, step and seek.

    Of a running suite it asks for hold, land and kill too, if the page is opened by the printed
    address: its token is needed for them.
    """
    source = given.source
    if source == SUITE:
        os.nice(NICENESS)
    try:
        import websockets  # noqa: F401  uvicorn loads it at the first page, too late for a word

        from tombo_web.server import Address, serve_live

        if given.foxglove is not None:
            import tombo_web.foxglove_stream  # noqa: F401
    except ModuleNotFoundError as error:
        raise InputError(f"{error.name} is not installed; accepted: after `make live`") from error
    port = PORT if server.port is None else server.port
    names, address = reading.names, Address(server.host, port, given.foxglove)
    if source == SUITE:
        text = json.dumps({**vars(address), "names": names})
        os.execv(sys.executable, [sys.executable, "-m", "tombo_web.live_node", text])
    from tombo_flight.report.figures import drawn_obstacle
    from tombo_web.playback import Playback

    flight = _flight(source, draw.seed or 0, reading.mapping, names)
    serve_live(
        Playback(flight, 1.0 if pace.speed is None else pace.speed),
        flight.name,
        address,
        flight.scenario,
        drawn_obstacle(flight.scenario),
    )


def _flight(source: str, seed: int, mapping: str | None, names: dict[str, str]) -> Flight:
    """Return the flight of a log, or of a scenario, by its name or its file.

    Raises:
        InputError: it is neither, or can't be used.
    """
    path = Path(source)
    is_scenario = path.suffix in (".yaml", ".yml")
    if path.exists() and not is_scenario:
        from tombo_logs.readers.log_reader import read_every_topic

        return read_every_topic(path, mapping, names)[0]
    if not is_scenario and (path.suffix or len(path.parts) > 1):
        raise InputError(
            f"'{source}' does not exist; accepted: suite, a recording or another log, a scenario"
        )
    from tombo_flight.flight import fly_scenario
    from tombo_flight.scenario import load_scenario

    return fly_scenario(load_scenario(source), seed)
