"""`tombo replay`: a recorded run once more through the nodes' cores, and what differs."""

from __future__ import annotations

from pathlib import Path

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import argument, command, option, record
from tombo_bringup.cli.result_files import publish

app = typer.Typer()

REPLAY_EXIT_CODES = (
    "Exit code: 0 also when recorded and replayed differ (that is a result); with --strict 1 "
    "when they differ by more than the tolerances; 2 for bad input."
)
FILE = "replay.json"
"""Result in the folder of -o."""


@record
class _Replay:
    bag: Path = argument("BAG", "MCAP file, rosbag2 folder (MCAP or SQLite), .db3, or ROS 1 .bag.")
    nodes: list[str] | None = option(
        "--node NODE",
        "detector, reaction, mission, estimator or controller; may be given many times. Default: "
        "each whose inputs are in the bag.",
    )
    scenario: str | None = option(
        "--scenario SCENARIO", "Its parameters over the bag's: YAML file or name."
    )
    frame_ok: str | None = option("--frame-ok NAME", "Take this frame_id of poses for map.")
    shift_stamps: float = option(
        "--shift-stamps S", "Add S seconds to the poses' stamps.", 0.0, bounds=(-1e10, 1e10)
    )
    stamp_on_arrival: bool = option(
        "--stamp-on-arrival", "Stamp poses when they arrived, not by header.", False
    )
    strict: bool = option("--strict", "Exit with 1 if there is a difference.", False)


@command(app, epilog=REPLAY_EXIT_CODES)
def replay(
    given: _Replay,
    imports: options.Imports,
    topics: options.Topics,
    settings: options.Settings,
    copies: options.Copies,
) -> None:
    """Feed a recorded run to the nodes' own code and compare the outputs with the recorded ones.

    Inputs are fed in the order and at the times of their arrival, with the stamps of their
    headers. Parameters are those of the recorded flight if the bag has them; --set changes one
    over them, as detector.threshold=30. With -o also replay.json, over that of an earlier replay.
    """
    from tombo_flight.replay.run import ReplayRequest, replay_bag, replay_page

    request = ReplayRequest(
        nodes=_nodes(given.nodes or []),
        names=topics.names,
        frame_ok=given.frame_ok,
        shift_stamps_s=given.shift_stamps,
        stamp_on_arrival=given.stamp_on_arrival,
        scenario=given.scenario,
        settings=tuple(settings.settings or ()),
    )
    result, _ = publish(
        options.Results(as_json=copies.as_json, output=copies.output, force=True),
        name=None,
        files=(FILE,),
        compute=lambda on_progress: replay_bag(given.bag, request),
        page=lambda result, folder: replay_page(result),
    )
    raise typer.Exit(1 if given.strict and result.differences else 0)


def _nodes(names: list[str]) -> tuple[str, ...]:
    """Return the nodes of --node in the order of `NODES`; refuse other names."""
    from tombo_dynamics.errors import unknown_name
    from tombo_flight.replay.compared import NODES

    for name in names:
        if name not in NODES:
            raise unknown_name("--node", name, NODES)
    return tuple(name for name in NODES if name in names)
