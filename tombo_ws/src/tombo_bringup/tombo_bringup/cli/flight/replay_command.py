"""`tombo replay`: a recorded run once more through the nodes' cores, and what differs."""

from __future__ import annotations

import dataclasses
import signal
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tombo_bringup.cli.options import (
    Imports,
    TopicNames,
    UnpackLimit,
    former_option,
    json_option,
    option,
    output_option,
    topic_names,
)
from tombo_bringup.cli.result_files import check_output
from tombo_bringup.cli.tables import show_page
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_flight.replay.metrics import Tolerances
    from tombo_flight.replay.run import Replay, ReplayRequest

app = typer.Typer()

REPLAY_EXIT_CODES = (
    "Exit code: 0 also when recorded and replayed differ (that is a result); with --strict 1 "
    "when they differ by more than the tolerances; 2 for bad input."
)
FILES = ("replay.json", "replay.png")


@app.command(epilog=REPLAY_EXIT_CODES)
def replay(
    bag: Annotated[
        Path,
        typer.Argument(
            metavar="BAG", help="MCAP file, rosbag2 folder (MCAP or SQLite), .db3, or ROS 1 .bag."
        ),
    ],
    nodes: Annotated[
        list[str] | None,
        option(
            "--node NODE",
            "detector, reaction, mission, estimator or controller; may be given many times. "
            "Default: each whose inputs are in the bag.",
        ),
    ] = None,
    imports: Imports = None,
    maps: TopicNames = None,
    scenario: Annotated[
        str | None,
        option("--scenario SCENARIO", "Its parameters over the bag's: YAML file or name."),
    ] = None,
    params: Annotated[str | None, former_option("--params SCENARIO", "--scenario")] = None,
    settings: Annotated[
        list[str] | None,
        option(
            "--set KEY=VALUE",
            "One parameter over the bag's, as in detector.threshold=30. May be given many times.",
        ),
    ] = None,
    frame_ok: Annotated[
        str | None, option("--frame-ok NAME", "Take this frame_id of poses for map.")
    ] = None,
    shift_stamps: Annotated[
        float, option("--shift-stamps S", "Add S seconds to the poses' stamps.")
    ] = 0.0,
    stamp_on_arrival: Annotated[
        bool, option("--stamp-on-arrival", "Stamp poses when they arrived, not by header.")
    ] = False,
    dds: Annotated[
        bool, option("--dds", "Through the real nodes over DDS, as stamped, not the cores.")
    ] = False,
    speed: Annotated[
        float, option("--speed X", "With --dds: recorded time against real time.")
    ] = 1.0,
    strict: Annotated[bool, option("--strict", "Exit with 1 if there is a difference.")] = False,
    tolerances: Annotated[
        list[str] | None,
        option(
            "--tolerance KEY=VALUE",
            "What counts as a difference: time_ms, x_c_m, statistic, setpoint_m, odometry_m or "
            "command_rad_s. May be given many times.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        output_option("Write replay.json and replay.png there, over those of an earlier replay."),
    ] = None,
    unpack_limit: UnpackLimit = None,
    as_json: Annotated[bool, json_option("Print one JSON object, and nothing else.")] = False,
) -> None:
    """Feed a recorded run to the nodes' own code and compare with what was recorded.

    Inputs are fed in the order and at the times of their arrival, with the stamps of their
    headers. Parameters are those of the recorded flight if the bag has them.
    """
    from tombo_flight.process.output_folder import open_output
    from tombo_flight.replay.page import draw_replay, replay_page
    from tombo_flight.replay.run import ReplayRequest, replay_bag
    from tombo_flight.report.flight_plot import figure_bytes
    from tombo_flight.report.page import page_json

    request = ReplayRequest(
        nodes=_nodes(nodes or []),
        names=topic_names("--map", maps or []),
        frame_ok=frame_ok,
        shift_stamps_s=_finite("--shift-stamps", shift_stamps),
        stamp_on_arrival=stamp_on_arrival,
        scenario=scenario or params,
        settings=tuple(settings or ()),
        tolerances=_tolerances(tolerances or []),
    )
    _check_speed(dds, speed)
    check_output(output)
    with ExitStack() as stack:
        folder = None
        if output is not None:
            folder = stack.enter_context(open_output(Path(output), replace=True, results=FILES))
        result = _through_nodes(bag, request, speed) if dds else replay_bag(bag, request)
        page = replay_page(result)
        if folder is not None:
            (folder / FILES[0]).write_text(page_json(page), encoding="utf-8", newline="\n")
            (folder / FILES[1]).write_bytes(figure_bytes(draw_replay(result)))
            folder.publish()
    show_page(page, as_json, None if as_json or output is None else Path(output), FILES)
    raise typer.Exit(1 if strict and result.differences else 0)


def _check_speed(dds: bool, speed: float) -> None:
    if not dds and speed != 1.0:
        raise InputError(f"--speed {speed:g}: without --dds it is always as fast as possible")
    if not 0.05 <= speed <= 20.0:
        raise InputError(f"--speed {speed:g}: out of bounds; accepted: 0.05 to 20")


def _through_nodes(bag: Path, request: ReplayRequest, speed: float) -> Replay:
    """Replay through live nodes; a signal ends them before this process."""
    from tombo_bringup.cli.progress import progress_bar
    from tombo_flight.process.stop_signals import StopSignals
    from tombo_flight.replay.run import replay_bag
    from tombo_flight.replay.through_nodes import Interrupted, ThroughNodes

    with StopSignals(signal.SIGHUP) as stop, progress_bar() as on_progress:
        try:
            return replay_bag(bag, request, ThroughNodes(speed, on_progress, stop.asked))
        except Interrupted:
            typer.echo("Error: interrupted", err=True)
            raise typer.Exit(stop.exit_code) from None


def _nodes(names: list[str]) -> tuple[str, ...]:
    from tombo_dynamics.errors import unknown_name
    from tombo_flight.replay.outputs import NODES

    for name in names:
        if name not in NODES:
            raise unknown_name("--node", name, NODES)
    return tuple(name for name in NODES if name in names)


def _tolerances(texts: list[str]) -> Tolerances:
    from tombo_dynamics.errors import unknown_name
    from tombo_flight.replay.metrics import Tolerances

    names = [field.name for field in dataclasses.fields(Tolerances)]
    found: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name not in names:
            raise unknown_name("--tolerance", name, names)
        try:
            found[name] = float(value)
        except ValueError:
            raise InputError(f"--tolerance {text}: no number; accepted: {name}=NUMBER") from None
        if not found[name] >= 0.0:
            raise InputError(f"--tolerance {text}: out of bounds; accepted: 0 and above")
    return Tolerances(**found)


def _finite(option: str, value: float) -> float:
    if not abs(value) < 1e10:
        raise InputError(f"{option} {value:g}: accepted: a number of seconds")
    return value
