"""`tombo hil`: the simulator of a real PX4, until it is stopped."""

from __future__ import annotations

import signal
import time
from contextlib import closing
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.errors import printable
from tombo_bringup.cli.options import command, option, record

if TYPE_CHECKING:
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_px4.hil.lockstep import HilSimulator
    from tombo_sim.world import World

app = typer.Typer()

HIL_EXIT_CODES = (
    "Exit code: 0 when it was stopped (Ctrl-C, SIGTERM, --duration), 2 for bad input or a port "
    "that is taken."
)
_WAIT_S = 0.1


@record
class _Hil:
    port: int = option("--port N", "TCP port for PX4: 4560 plus its instance.", 4560)


@command(app, lab=True, hidden=True, epilog=HIL_EXIT_CODES)
def hil(
    scene: options.Scene,
    given: _Hil,
    settings: options.Settings,
    draw: options.Draw,
    pace: options.Pace,
    duration: options.Duration,
) -> None:
    """Let a real PX4 (SITL, none_iris) fly the Tombo vehicle: physics in lockstep over TCP.

    The scenario's vehicle, propeller, effects and obstacle are simulated; PX4 does the rest. With
    --speed 0 time goes as fast as PX4 answers.
    """
    from tombo_dynamics.errors import InputError
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.scenario import load_scenario, world_of
    from tombo_px4.hil.flight import HilFlight
    from tombo_px4.hil.lockstep import HilSimulator

    speed, seed = 1.0 if pace.speed is None else pace.speed, draw.seed or 0
    if not 0.0 <= speed <= 100.0:
        raise InputError(f"--speed {speed:g}: out of bounds; accepted: a number from 0 to 100")
    scenario = scene.scenario
    world = world_of(load_scenario(scenario, settings.settings or []))
    with (
        StopSignals(signal.SIGHUP) as stop,
        closing(HilSimulator(lambda: HilFlight(world, seed), given.port, speed, _tell)) as one,
    ):
        print(_introduction(world, one.port, scenario, seed), flush=True)
        _serve(one, stop, duration.duration)


def _introduction(world: World, port: int, scenario: str, seed: int) -> str:
    """Return the text at the start: the simulator, and the commands that start PX4."""
    from tombo_px4.bridge.vehicle_parameters import MOCAP_ONLY
    from tombo_px4.hil.flight import airframe_parameters, exported, start_command

    return f"""\
{scenario}, seed {seed}: waiting for PX4 on TCP port {port} of 127.0.0.1. Start it with

{start_command(port, airframe_parameters(world, seed))}

PX4 connects once: start it again after this. It keeps these parameters; without \
parameters*.bson of build/px4_sitl_default/rootfs it begins with its own again.

To fly by motion capture alone, as `tombo fly --px4` does, PX4 needs these, too:

{exported(MOCAP_ONLY)}"""


def _tell(text: str, severe: bool) -> None:
    print(f"{'! ' if severe else ''}{printable(text)}", flush=True)


def _serve(one: HilSimulator, stop: StopSignals, duration_s: float | None) -> None:
    """Run until it is stopped."""
    began = time.monotonic()
    over = False
    while not (over or stop.requested()):
        now_ns = time.monotonic_ns()
        if not one.advance(now_ns):
            one.wait(now_ns, _WAIT_S)
        over = duration_s is not None and time.monotonic() - began >= duration_s
    print(f"stopped after {one.flights} flights, {one.steps} steps, {one.missed} missed")
