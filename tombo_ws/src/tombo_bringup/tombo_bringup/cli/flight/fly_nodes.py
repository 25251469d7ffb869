"""`tombo fly --nodes` and `--px4`: one flight by the ROS 2 nodes, or by them and a PX4."""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli.errors import print_error
from tombo_bringup.cli.flight.node_tables import print_node_flight, print_verdict
from tombo_bringup.cli.progress import progress_bar
from tombo_bringup.cli.result_files import Place
from tombo_dynamics.errors import InputError
from tombo_flight.process.stop_signals import Stopped, StopSignals
from tombo_flight.run_wiring import warm_up_nodes
from tombo_flight.suite.node_flight import NotFlown, fly_nodes_and_save
from tombo_flight.suite.px4_connection import Px4Connection, find_vehicle
from tombo_px4.bridge.vehicle_parameters import parse_assignments

if TYPE_CHECKING:
    from tombo_flight.scenario import Scenario


def fly_nodes(
    scenario: Scenario,
    seed: int,
    place: Place,
    *,
    as_json: bool,
    speed: float,
    domain: int | None,
    lockstep: bool,
    px4: Px4Connection | None,
    yes: bool,
) -> int:
    """Fly, print, and return the exit code.

    Args:
        scenario: what to fly.
        seed: of the simulator's random draws.
        place: where the results go.
        as_json: print the summary as JSON, and nothing else.
        speed: of simulated time against real time.
        domain: ROS_DOMAIN_ID.
        lockstep: run the ticks of the headless flight.
        px4: fly over MAVLink.
        yes: arm a PX4 that is there without asking.

    Raises:
        InputError: PX4 can't be reached or must not be armed, or as `fly_nodes_and_save`.
    """
    with progress_bar() as on_progress:
        on_progress("loading", 0.0)
        warm_up_nodes(scenario)
    with StopSignals(signal.SIGHUP) as stop:
        try:
            if not may_arm(px4, scenario, stop, yes=yes):
                return stop.exit_code or 1
            with progress_bar() as on_progress, place.open() as folder:
                try:
                    flight, run = fly_nodes_and_save(
                        folder, scenario, seed, stop, speed=speed, domain=domain,
                        on_progress=on_progress, lockstep=lockstep, px4=px4,
                        notice=lambda text: typer.echo(text, err=True),
                    )  # fmt: skip
                except NotFlown as error:
                    folder.publish()
                    print_error(f"{error}; recording and logs are in '{folder.path}'")
                    return 1
                names = sorted(p.name for p in folder.staging.iterdir())
                folder.publish()
        except Stopped:  # before anything was flown: nothing to keep
            return stop.exit_code
    print_node_flight(flight, run, folder.path, names, as_json)
    if not (as_json or lockstep):  # a flight in lockstep is the same on every machine
        print_verdict(flight.summary)
    if run.left_armed:
        print_error(run.left_armed)
    elsewhere = flight.summary["ends_elsewhere"] if px4 is not None else None
    if elsewhere and not stop.exit_code:
        print_error(f"the flight did not end in a landing where it should: {elsewhere}")
    if run.loss:
        print_error(f"a loss ended the flight: {run.loss}")
    failed = run.died or run.left_armed or elsewhere or run.loss
    return stop.exit_code or int(bool(failed))


def may_arm(
    connection: Px4Connection | None,
    scenario: Scenario,
    stop: StopSignals,
    *,
    yes: bool,
    flies: bool = True,
) -> bool:
    """Return True without a real vehicle; else print what is about to be armed, and ask.

    Without a mission (`flies` false) nothing arms by itself: there is nothing to ask.

    Raises:
        InputError: there is nothing to arm, or nobody to ask.
        Stopped: a signal came before the answer.
    """
    if connection is None or connection.simulated:
        return True
    url = connection.link.url
    if flies and not yes and not sys.stdin.isatty():
        raise InputError(
            f"--px4 {url}: this arms a vehicle and flies it; accepted: with --yes, or on a "
            "terminal where it can be confirmed"
        )
    names = tuple(parse_assignments(connection.writes))
    vehicle = find_vehicle(connection.link, parameters=names, stop=stop.requested)
    if vehicle is None:
        return False
    if vehicle.armed:
        raise InputError(
            f"--px4 {url}: {vehicle.description}: somebody else flies it; "
            "accepted: a disarmed vehicle"
        )
    plan = f"takes off to {scenario.mission.height:g} m and flies {scenario.name}"
    will = f"This arms it, {plan}." if flies else "Without the mission nothing arms it."
    typer.echo(f"At {url} is {vehicle.description}. {will}", err=True)
    if yes or not flies:
        return True
    with stop.at_once():
        if typer.confirm("Is the flight space clear? Arm and fly", err=True):
            return True
    print_error("not confirmed: nothing was armed")
    return False
