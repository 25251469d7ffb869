"""`tombo up`: the whole suite as processes, until it is stopped."""

from __future__ import annotations

import dataclasses
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tombo_bringup.cli.flight.optional_url import PX4_RULES, PX4_SPEED, OptionalUrlCommand, url_of
from tombo_bringup.cli.options import (
    BridgeSettings,
    Disturbed,
    Duration,
    Imports,
    ModelFile,
    Px4Url,
    ReactionName,
    ScenarioArgument,
    Seed,
    Settings,
    VehicleName,
    Yes,
    check_options,
    former_option,
    integer_option,
    json_option,
    option,
    output_option,
)
from tombo_bringup.cli.result_files import check_output

if TYPE_CHECKING:
    from tombo_flight.suite.running import SuiteConfig

app = typer.Typer()

UP_EXIT_CODES = (
    "Exit code: 0 when it was stopped (Ctrl-C, SIGTERM, --duration), 1 when a node ended by "
    "itself before, or when arming was not confirmed, 2 for bad input."
)

_LOOK_S = 0.1


@app.command(epilog=UP_EXIT_CODES, cls=OptionalUrlCommand)
def up(
    scenario: ScenarioArgument = "paper_collision",
    reaction: ReactionName = None,
    disturbances: Disturbed = False,
    imports: Imports = None,
    settings: Settings = None,
    model: ModelFile = None,
    vehicle: VehicleName = None,
    seed: Seed = 0,
    without: Annotated[
        list[str] | None, option("--without NODE", "Leave a node out. May be given many times.")
    ] = None,
    params: Annotated[
        list[Path] | None,
        option(
            "--params FILE",
            "A ROS parameter file over those of the scenario. May be given many times.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        output_option("Folder of recording, parameters and logs. Default: runs/up-DATE-TIME."),
    ] = None,
    record: Annotated[str | None, former_option("--record DIR", "-o")] = None,
    px4: Px4Url = None,
    yes: Yes = False,
    bridge: BridgeSettings = None,
    speed: Annotated[float, option("--speed X", "Simulated time against real time.")] = 1.0,
    domain: Annotated[
        int | None,
        integer_option("--domain N", "ROS_DOMAIN_ID. Default: that of the environment."),
    ] = None,
    duration: Duration = None,
    as_json: Annotated[
        bool, json_option("Print JSON lines: the status each 5 s, ends at once.")
    ] = False,
) -> None:
    """Start simulator, estimator, detector, reaction, mission, controller and recorder.

    On a terminal the keys h, l and kk ask the nodes to hold, to land, and to switch the rotors off
    at once.

    With --px4 PX4 stands for estimator and controller. Each is a process of its own and a ROS 2
    node; Ctrl-C stops them. A node that ends by itself is reported and not started again; the
    others go on. Without the simulator nothing flies before `tombo call takeoff`.
    """
    from tombo_bringup.cli.flight.fly_command import over_scenario
    from tombo_bringup.cli.flight.fly_nodes import may_arm
    from tombo_flight.process.stop_signals import Stopped, StopSignals
    from tombo_flight.run_wiring import warm_up_nodes
    from tombo_flight.scenario import load_scenario
    from tombo_flight.suite.node_flight import over_mavlink
    from tombo_flight.suite.px4_connection import px4_connection
    from tombo_flight.suite.running import SuiteConfig

    url = None if px4 is None else url_of(px4)
    given = {"px4": px4, "px4_url": url, "model": model, "yes": yes, "bridge": bridge}
    check_options((*PX4_RULES, PX4_SPEED), {**given, "speed": None if speed == 1.0 else speed})
    connection = None if px4 is None else px4_connection(url, bridge or [])
    over_set = over_scenario(reaction, disturbances=disturbances)
    over = {} if connection is None else over_mavlink(connection)
    real = "sim" in (*(without or ()), *over.get("without", ()))
    if real:  # what really flies waits for ~/takeoff
        over["more"] = {**over.get("more", {}), "mission": {"auto_start": False}}
    named = output if output is not None else record
    check_output(named)
    folder = Path(named or time.strftime("runs/up-%Y%m%d-%H%M%S"))
    config = SuiteConfig(
        scenario=load_scenario(scenario, [*over_set, *(settings or [])], model, vehicle),
        seed=seed,
        folder=folder,
        recording=_recording(folder),
        files=tuple(params or ()),
        speed=speed,
        domain=domain,
        monitor=("--flight", "--mocap"),
        **{**over, "without": (*over.get("without", ()), *(without or ()))},
    )
    warm_up_nodes(config.scenario)  # compiles what is not compiled yet, and finds bad input
    try:
        with StopSignals() as stop:
            flies = "mission" in config.nodes
            allowed = may_arm(connection, config.scenario, stop, yes=yes, flies=flies)
    except Stopped:
        allowed = False
    if allowed and named is None:
        config = _in_new_folder(config)
    raise typer.Exit(_watch(config, duration, as_json) if allowed else 1)


def _recording(folder: Path) -> dict[str, str]:
    return {"output": str((folder / "bag").absolute())}


def _in_new_folder(config: SuiteConfig) -> SuiteConfig:
    """Make the folder, with a number where another suite has it."""
    from tombo_flight.process.output_folder import make_numbered

    config.folder.parent.mkdir(exist_ok=True)
    folder = make_numbered(config.folder)
    return dataclasses.replace(config, folder=folder, recording=_recording(folder))


def _watch(config: SuiteConfig, duration_s: float | None, as_json: bool) -> int:
    """Run the suite until it is stopped, or nothing of it is left; return the exit code."""
    from tombo_bringup.cli.flight.keys import HELP, Keys
    from tombo_bringup.cli.flight.suite_screen import new_screen
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.suite.running import LOGS, RunningSuite

    with StopSignals(signal.SIGHUP) as stop, new_screen(as_json) as screen, Keys() as keys:
        if keys.there:
            screen.notice(HELP)
        with RunningSuite(config) as suite:
            while not stop.asked() and suite.running:
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
