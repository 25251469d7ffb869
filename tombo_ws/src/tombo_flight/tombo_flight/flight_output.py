"""One flight with all its files: `flight.mcap`, summary, figure and report."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tombo_flight.command_line import command_line
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.json_text import as_json, plain
from tombo_flight.own_files import imported_files
from tombo_flight.process.stop_signals import Stopped, StopSignals
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.scenario import Scenario, as_mapping
from tombo_flight.version import tombo_version
from tombo_flight.yaml_file import yaml_of

if TYPE_CHECKING:
    from tombo_bag.flight import Flight
    from tombo_flight.process.output_folder import OutputFolder
    from tombo_flight.report.page import Page

WALL_KEYS = ("wall_time_s", "real_time_factor")
"""Keys that differ between flights of one scenario and seed; all other bytes agree."""
SCENARIO_FILE = "scenario.yaml"

_REHEARSAL_S = 0.1


def flown_page(flight: Flight) -> Page:
    """Return the page of a flight for a terminal, with how fast it was flown.

    Args:
        flight: its summary is that of `flight_summary`.
    """
    from tombo_flight.report.flight_report import flight_page

    summary = flight.summary
    line = f"Flown in {summary['wall_time_s']:.3f} s"
    if (factor := summary["real_time_factor"]) is not None:
        line += f", {factor:.{0 if factor >= 10 else 2}f} times real time"
    if summary["recorded_messages"] is not None:
        line += f"; {summary['recorded_messages']} messages recorded"
    cut = f"Interrupted after {summary['duration_s']:.3f} s of flight."
    remarks = [cut] if summary["interrupted"] else []
    return flight_page(flight, remarks=[*remarks, f"{line}."])


def warm_up_flight(scenario: Scenario) -> None:
    """Fly the first tenth of a second, to load the compiled code and to find bad input.

    Raises:
        InputError: as `fly_scenario`.
    """
    fly_scenario(dataclasses.replace(scenario, duration=_REHEARSAL_S), 0)


def flight_summary(
    flight: Flight, *, interrupted: bool = False, recorded_messages: int | None = None
) -> dict[str, Any]:
    """Return the content of `summary.json`: plain values, never NaN, wall times last.

    Args:
        flight: with its summary.
        interrupted: it was ended from outside before its time.
        recorded_messages: number of messages in `flight.mcap`; None: not recorded.
    """
    figures = {key: value for key, value in flight.summary.items() if key not in WALL_KEYS}
    ordered = {
        "tombo_version": tombo_version(),
        **figures,
        "interrupted": interrupted,
        "recorded_messages": recorded_messages,
        **{key: flight.summary.get(key) for key in WALL_KEYS},
    }
    summary: dict[str, Any] = plain(ordered)
    return summary


def fly_into(
    folder: OutputFolder,
    scenario: Scenario,
    seed: int,
    stop: StopSignals,
    *,
    record: bool = True,
    on_progress: ProgressCallback = no_progress,
) -> Flight:
    """Fly a scenario and write its files into an output folder, which the caller publishes.

    A stopped flight leaves `flight.mcap`, `summary.json` and `scenario.yaml` up to that time; a
    stop after the flight leaves out the pictures that are not yet drawn.

    Args:
        folder: where the files go.
        scenario: what to fly; `warm_up_flight` it first.
        seed: all randomness derives from it.
        stop: watched between samples of the motion capture.
        record: write `flight.mcap`.
        on_progress: receives the progress.

    Raises:
        OSError: the files can't be written.
    """
    interrupted = False

    def cut() -> bool:
        nonlocal interrupted
        interrupted = stop.requested()
        return interrupted

    flown = fly_scenario(
        scenario,
        seed,
        Workspace(),
        progress=lambda now: on_progress("flying", now / scenario.duration),
        stop=cut,
    )
    messages = None
    if record:
        on_progress("writing flight.mcap", 0.0)
        messages = write_mcap(flown, folder / "flight.mcap")
    summary = flight_summary(flown, interrupted=interrupted, recorded_messages=messages)
    flown = dataclasses.replace(flown, summary=summary)
    write_scenario(folder / SCENARIO_FILE, scenario, seed)
    (folder / "summary.json").write_text(as_json(summary), encoding="utf-8", newline="\n")
    if not interrupted:
        draw_pictures(flown, folder, stop, on_progress)
    return flown


def write_scenario(path: Path, scenario: Scenario, seed: int) -> None:
    """Write the complete scenario, which `tombo fly` flies again, whatever the defaults become.

    Args:
        path: of the file.
        scenario: the scenario that was flown, with the effects of its model.
        seed: as flown.

    Raises:
        OSError: it can't be written.
    """
    imports = [("--import", file) for file, _ in imported_files()]
    again = command_line(("fly", SCENARIO_FILE, "--seed", str(seed)), imports)
    head = f"# tombo {tombo_version()}; to fly it again: {again}\n"
    if scenario.model:
        head += f"# Effects with those of the model '{scenario.model}'.\n"
    path.write_text(head + yaml_of(complete_mapping(scenario)), encoding="utf-8", newline="\n")


def complete_mapping(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as written to a file of any folder: without a model, paths absolute."""
    values = as_mapping(scenario)
    values.pop("model", None)
    library = values["propeller"].get("library")
    if library:
        values["propeller"]["library"] = str(Path(library).absolute())
    return values


def write_mcap(flight: Flight, path: Path) -> int:
    """Write `flight.mcap`; return its number of messages."""
    from tombo_bag.flight_topics import write_flight
    from tombo_bag.formats.mcap_sink import McapSink

    with McapSink(path) as sink:
        write_flight(sink, flight)
    return sink.message_counts.total()


def draw_pictures(
    flight: Flight,
    folder: OutputFolder,
    stop: StopSignals,
    on_progress: ProgressCallback = no_progress,
) -> None:
    """Write the picture and `report.html`, or neither if a stop comes meanwhile."""
    pictures = [folder / "flight.png", folder / "report.html"]
    try:
        with stop.at_once():
            on_progress("drawing flight.png", 0.0)
            from tombo_flight.report.flight_plot import draw_flight
            from tombo_flight.report.style import figure_bytes

            figure = draw_flight(flight)
            pictures[0].write_bytes(figure_bytes(figure))
            on_progress("writing report.html", 0.0)
            from tombo_flight.report.flight_report import report_page
            from tombo_flight.report.page import write_page

            write_page(pictures[1], report_page(flight, figure))
    except Stopped:
        for path in pictures:
            path.unlink(missing_ok=True)
