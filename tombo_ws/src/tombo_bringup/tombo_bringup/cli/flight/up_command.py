"""`tombo up`: the whole suite as processes, until it is stopped."""

from __future__ import annotations

import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.flight.optional_url import PX4_RULES, Px4Options, expand_url_option
from tombo_bringup.cli.options import Rule, command, option, record

if TYPE_CHECKING:
    from tombo_flight.suite.running import SuiteConfig

app = typer.Typer()

MOST_VEHICLES = 9
_RULES: tuple[Rule, ...] = (
    *PX4_RULES,
    ("speed", (), ("px4", "vehicles")),
    ("px4", (), ("vehicles",)),
)
UP_EXIT_CODES = (
    "Exit code: 0 when it was stopped (Ctrl-C, SIGTERM, --duration), 1 when a node ended by "
    "itself before, or when arming was not confirmed, 2 for bad input."
)

_LOOK_S = 0.1


@record
class _Up:
    without: list[str] | None = option(
        "--without NODE", "Leave a node out. May be given many times."
    )
    vehicles: int | None = option(
        "--vehicles N",
        "Fly so many vehicles side by side, in the namespaces v1, v2, each with its nodes in a "
        "process.",
        bounds=(1, MOST_VEHICLES),
    )


@command(app, lab=True, epilog=UP_EXIT_CODES, expand=expand_url_option)
def up(
    scene: options.Scene,
    variation: options.Variation,
    draw: options.Draw,
    more: _Up,
    px4: Px4Options,
    pace: options.Pace,
    domain: options.Domain,
    duration: options.Duration,
    place: options.Copies,
) -> None:
    """Start simulator, estimator, detector, reaction, mission, controller and recorder.

    On a terminal the keys h, l and kk ask the nodes to hold, to land, and to switch the rotors off
    at once.

    With --px4 PX4 replaces estimator and controller. Each is a process of its own and a ROS 2
    node; Ctrl-C stops them. A node that ends by itself is reported and not started again; the
    others go on. Without the simulator nothing flies before `tombo call takeoff`.

    The folder has recording, parameters and logs. With --json each line is JSON: the status each
    5 s, ends at once.
    """
    from tombo_bringup.cli.flight.fly_nodes import may_arm
    from tombo_flight.process.stop_signals import Stopped, StopSignals
    from tombo_flight.run_wiring import warm_up_nodes
    from tombo_flight.scenario import load_scenario
    from tombo_flight.suite.node_flight import over_mavlink
    from tombo_flight.suite.running import SuiteConfig

    speed = 1.0 if pace.speed is None else pace.speed
    vehicles = more.vehicles or 0
    given = {"speed": None if speed == 1.0 else speed, "vehicles": more.vehicles}
    options.check_options(_RULES, vars(variation) | px4.values | given)
    connection = px4.connection()
    changes, without = variation.changes, tuple(more.without or ())
    over = {} if connection is None else over_mavlink(connection)
    real = "sim" in (*without, *over.get("without", ()))
    if real:  # what really flies waits for ~/takeoff
        over["more"] = {**over.get("more", {}), "mission": {"auto_start": False}}
    folder = Path(place.output or time.strftime("runs/up-%Y%m%d-%H%M%S"))
    config = SuiteConfig(
        scenario=load_scenario(scene.scenario, changes, variation.model, variation.vehicle),
        seed=draw.seed or 0,
        folder=folder,
        recording={"output": str((folder / "bag").absolute())},
        speed=speed,
        domain=domain.domain,
        monitor=("--flight", "--mocap"),
        vehicles=vehicles,
        **{**over, "without": (*over.get("without", ()), *without)},
    )
    warm_up_nodes(config.scenario)  # compiles what is not compiled yet, and finds bad input
    try:
        with StopSignals() as stop:
            flies = "mission" in config.nodes
            allowed = may_arm(connection, config.scenario, stop, yes=px4.yes, flies=flies)
    except Stopped:
        allowed = False
    code = _watch(config, duration.duration, place.as_json) if allowed else 1
    raise typer.Exit(code)


def _watch(config: SuiteConfig, duration_s: float | None, as_json: bool) -> int:
    """Run the suite until it is stopped, or nothing of it is left; return the exit code."""
    from tombo_bringup.cli.flight.keys import HELP, Keys
    from tombo_bringup.cli.flight.suite_screen import Screen
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.suite.running import LOGS, RunningSuite

    screen = Screen(as_json=as_json)
    with StopSignals(signal.SIGHUP) as stop, screen.shown(), Keys() as keys:
        if keys.there:
            screen.notice(HELP)
        with RunningSuite(config) as suite:
            while not stop.requested() and suite.running:
                for request in keys.requests():
                    if request == "kill?":
                        screen.notice("kill: once more within a second switches the rotors off")
                    elif not suite.request(request):
                        screen.warning(request, "not asked for: the monitor does not run")
                news = suite.poll(_LOOK_S)
                for answer in news.answers:
                    screen.answer(answer)
                for node, line in news.warnings:
                    screen.warning(node, line)
                for end in news.ended:
                    screen.ended(end, str(config.folder / LOGS / f"{end.name}.log"))
                screen.status(suite.status())
                if duration_s is not None and suite.uptime_s >= duration_s:
                    break
            not_well = suite.stop()
        screen.closing(not_well, str(config.folder))
    return 1 if suite.ended else 0
