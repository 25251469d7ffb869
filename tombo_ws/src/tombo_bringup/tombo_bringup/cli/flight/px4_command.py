"""`tombo px4`: the simulated vehicle as a PX4 that any MAVLink client can fly."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.errors import printable
from tombo_bringup.cli.options import command, option, record

if TYPE_CHECKING:
    from tombo_flight.scenario import Scenario
    from tombo_px4.autopilot.parameters import ParameterTable
    from tombo_px4.autopilot.vehicle import Px4Vehicle
    from tombo_px4.link.mavlink_link import Link
    from tombo_px4.protocol.endpoint import Endpoint

app = typer.Typer()

PX4_EXIT_CODES = (
    "Exit code: 0 when it was stopped (Ctrl-C, SIGTERM, --duration), 2 for bad input or a busy "
    "port."
)
_PORT, _GROUND_PORT = 14540, 14550
_ONBOARD_OFFSET, _GROUND_OFFSET = 40, 4030
"""From the client's port to the vehicle's, as with PX4's instances: 14580 and 18570 for 14540."""
_HIGHEST = 65535
_HERE = "127.0.0.1"
_WARM_UP_TICKS = 60


@record
class _Px4:
    port: int = option(
        "--port N",
        "UDP port of the on-board client; the vehicle's own are N+40 and N+4030, as with PX4's "
        "instances.",
        _PORT,
        bounds=(1, _HIGHEST - _GROUND_OFFSET),
    )
    ground_port: int = option(
        "--ground-port N", "UDP port of the ground station.", _GROUND_PORT, bounds=(1, _HIGHEST)
    )
    key: Path | None = option(
        "--key FILE", "Key of MAVLink's signatures: only who has it is heard."
    )
    write_params: Path | None = option(
        "--write-params FILE",
        "Write the parameters that a real PX4 needs, each with its reason, for QGroundControl; "
        "and leave.",
    )


@command(app, lab=True, epilog=PX4_EXIT_CODES)
def px4(
    scene: options.Scene,
    given: _Px4,
    draw: options.Draw,
    settings: options.Settings,
    duration: options.Duration,
) -> None:
    """Simulate a vehicle with a PX4 autopilot and serve MAVLink, as PX4's own simulation does.

    MAVSDK, MAVProxy, QGroundControl and the bridge of `tombo fly --px4` can fly it, on this
    machine; from other ones with px4_sim_node and its parameter allow_remote (docs/px4.md).
    """
    from tombo_flight.scenario import load_scenario
    from tombo_px4.autopilot.parameters import ParameterTable
    from tombo_px4.protocol.endpoint import Endpoint

    def tell(_: int, text: str) -> None:
        print(f"{vehicle.boot_us * 1e-6:8.2f} s  {printable(text)}", flush=True)

    if given.write_params is not None:
        _write_parameters(given.write_params)
        return
    table = ParameterTable()
    chosen = load_scenario(scene.scenario, settings.settings or [])
    with ExitStack() as stack:
        links = _open_links(given, table, stack)
        vehicle = _vehicle(chosen, draw.seed or 0, table)
        _serve(Endpoint(vehicle, links, tell), duration.duration, _where_to_connect(given))


def _write_parameters(path: Path) -> None:
    from tombo_bringup.cli.result_files import check_new_file
    from tombo_flight.process.output_folder import write_whole
    from tombo_px4.bridge.vehicle_parameters import parameter_file

    check_new_file(path)
    write_whole(path, parameter_file())
    typer.echo(f"{path}: QGroundControl, Parameters, Tools, Load from file")


def _where_to_connect(given: _Px4) -> list[str]:
    ground = given.ground_port
    return [
        "A simulated PX4 1.17 quadrotor. It exchanges messages with a client that listens at",
        f"  MAVSDK          udpin://{_HERE}:{given.port}",
        f"  MAVProxy        mavproxy.py --master=udpin:{_HERE}:{ground}",
        f"  QGroundControl  a UDP link that listens on port {ground} (14550: by itself)",
        "Ctrl-C stops it.",
    ]


def _open_links(given: _Px4, table: ParameterTable, stack: ExitStack) -> list[tuple[Link, str]]:
    """Open the vehicle's links to an on-board client and a ground station, until `stack` ends."""
    from tombo_px4.link.mavlink_link import Link, read_key

    text = "" if given.key is None else str(given.key)
    secret = read_key(text, lambda warning: typer.echo(f"Warning: {warning}", err=True))
    links: list[tuple[Link, str]] = []
    for number, offset, client, streams in (
        (0, _ONBOARD_OFFSET, given.port, "onboard"),
        (1, _GROUND_OFFSET, given.ground_port, "ground"),
    ):
        link = Link(
            f"udpin://{_HERE}:{given.port + offset}",
            system=int(table.get("MAV_SYS_ID")),
            component=int(table.get("MAV_COMP_ID")),
            clock=time.time_ns,
            key=secret,
            link_id=number,
            default_peer=f"{_HERE}:{client}",
        )
        links.append((stack.enter_context(closing(link)), streams))
    return links


def _vehicle(scenario: Scenario, seed: int, table: ParameterTable) -> Px4Vehicle:
    """Make the vehicle; a spare one flies first, so that all code is compiled and loaded."""
    from tombo_bringup.cli.progress import progress_bar
    from tombo_flight.scenario import world_of
    from tombo_px4.autopilot.parameters import ParameterTable
    from tombo_px4.autopilot.vehicle import Px4Vehicle

    world = world_of(scenario)
    with progress_bar() as on_progress:
        on_progress("loading", 0.0)
        spare = Px4Vehicle(world, seed, ParameterTable())
        for _ in range(_WARM_UP_TICKS):
            spare.step()
        return Px4Vehicle(world, seed, table)


def _serve(endpoint: Endpoint, duration_s: float | None, lines: list[str]) -> None:
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_px4.protocol.endpoint import serve

    with StopSignals(signal.SIGHUP) as stop:
        print("\n".join(lines), flush=True)
        end_s = time.monotonic() + (math.inf if duration_s is None else duration_s)
        slipped_ns = serve(
            endpoint,
            time.monotonic_ns,
            time.time_ns,
            lambda: stop.requested() or time.monotonic() >= end_s,
        )
    print("\n".join(_end_lines(endpoint, slipped_ns)), flush=True)


def _end_lines(endpoint: Endpoint, slipped_ns: int) -> Iterator[str]:
    """Yield the refusals, and how long it ran."""
    for reason, count in sorted(endpoint.refused.items()):
        yield f"  {count} x {reason}"
    late = f", {slipped_ns * 1e-9:.1f} s behind real time" if slipped_ns else ""
    yield f"stopped after {endpoint.vehicle.boot_us * 1e-6:.1f} s{late}"
