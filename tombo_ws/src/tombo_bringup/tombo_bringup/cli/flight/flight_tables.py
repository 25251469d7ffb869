"""Flights and campaigns on the terminal: the paper's figures beside those of the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from tombo_bringup.cli.tables import console, print_line, right
from tombo_flight.report import paper_values as paper
from tombo_flight.report.milestones import Outcome, find_milestones, reaction_words
from tombo_flight.report.paper_comparison import (
    PAPER_SCENARIOS,
    Row,
    comparison_rows,
    fixed,
    is_paper_flight,
)

if TYPE_CHECKING:
    from tombo_bag.flight import Flight
    from tombo_flight.flight_output import FlightResult

_COLOURS: Final = {
    Outcome.RECOVERED: "bold green",
    Outcome.CRASHED: "bold red",
    Outcome.NO_CONTACT: "bold",
    Outcome.NOT_SETTLED: "bold yellow",
}
_CAMPAIGN_ROWS: Final = (
    ("max_falling_distance_m", "fall [m]", 1.0, 2, paper.MEAN_MAX_FALLING_DISTANCE_M),
    ("unstable_phase_s", "unstable [s]", 1.0, 2, paper.UNSTABLE_PHASE_S),
    ("recovery_time_s", "recovery [s]", 1.0, 2, paper.MEAN_RECOVERY_TIME_S),
    ("strikes", "strikes", 1.0, 1, None),
    ("contact_known_s", "latency [ms]", 1e3, 0, None),
    ("settled_error_m", "settled [m]", 1.0, 3, None),
    ("max_tilt_rad", "tilt [rad]", 1.0, 2, None),
    ("hover_rms_m", "hover RMS [m]", 1.0, 3, None),
    ("approach_rms_m", "approach RMS [m]", 1.0, 3, None),
)
"""Key of the aggregate, words, factor to the unit shown, decimals, the paper's value."""


def print_flight(flight: FlightResult) -> None:
    """Print a flight's figures beside the paper's, and its verdict."""
    summary = flight.summary
    milestones = find_milestones(flight.record)
    columns = [_flight_rows(flight.record)]
    paper = is_paper_flight(flight.record.scenario)
    names = ["paper", "this flight"] if paper else ["this flight"]
    if flight.beside is not None:
        columns.append(_flight_rows(flight.beside))
        names.append(f"with {flight.beside.summary['reaction']}")
    title = _title(summary, f"seed {summary['seed']}")
    table = Table("", *right(*names), box=SIMPLE_HEAD, title=title)
    for rows in zip(*columns, strict=True):
        row = rows[0]
        if milestones.contact_s is not None:
            # Places are too wide to stand side by side in 80 columns.
            shown = row.flight_text is None or (row.name != "Outcome" and len(columns) == 1)
        else:
            shown = row.name != "Largest tilt" and row.flight is not None
        if shown:
            flown = [_cell(each, each.flight, each.flight_text) for each in rows]
            printed = [_cell(row, row.paper, row.paper_text)] if paper else []
            table.add_row(row.name, *printed, *flown)
    console().print(table)
    if summary["interrupted"]:
        print_line(f"Interrupted after {summary['duration_s']:.3f} s of flight.", "bold yellow")
    else:
        outcome = milestones.verdict.value.capitalize()
        text = f"{outcome}; {summary['duration_s']:.1f} s of flight."
        if milestones.crash_s is not None:
            text = f"Crashed at {milestones.crash_s:.1f} of {summary['duration_s']:.1f} s."
        print_line(text, _COLOURS[milestones.verdict])
    print_line(_speed(flight))


def _flight_rows(record: Flight) -> list[Row]:
    summary = record.summary
    return [
        *comparison_rows(find_milestones(record), record),
        Row("RMS error in hover", "m", None, summary["hover_rms_m"], 3),
        Row("RMS error in the approach", "m", None, summary["approach_rms_m"], 3),
        Row("False alarms", "", None, summary["false_alarms"], 0),
    ]


def print_campaign(campaign: Mapping[str, Any]) -> None:
    """Print how the flights of a campaign ended; of each figure median and 5 to 95 % range."""
    total = campaign["aggregate"]
    seeds = f"seeds {campaign['first_seed']} to {campaign['last_seed']}"
    of_paper = campaign["scenario"] in PAPER_SCENARIOS
    columns = right(*(["paper"] if of_paper else []), "median", "5 %", "95 %", "max", "of")
    title = _title(campaign, seeds)
    table = Table("", *columns, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title=title)
    for key, name, scale, digits, printed in _CAMPAIGN_ROWS:
        values = total[key]
        table.add_row(
            Text(name),
            *(["–" if printed is None else f"{printed:g}"] if of_paper else []),
            *(
                "–" if values[part] is None else fixed(scale * values[part], digits)
                for part in ("median", "p05", "p95", "max")
            ),
            str(values["count"]),
        )
    console().print(table)
    counts = ("collided", "detected", "recovered", "crashed", "landed")
    low, high = total["crash_rate_95"]
    more = {"crashed": f" ({100.0 * low:.1f} to {100.0 * high:.1f} %)"}
    line = ", ".join(f"{total[name]} {name}{more.get(name, '')}" for name in counts)
    alarms = total["false_alarms"]
    colour = "bold red" if 2 * total["crashed"] > total["flights"] else "bold green"
    print_line(f"{total['flights']} flights: {line}; {alarms} false alarms.", colour)
    for flight in campaign["not_flown"][:1]:
        count, seed = len(campaign["not_flown"]), flight["seed"]
        print_line(f"{count} not flown; the first: seed {seed}: {flight['error']}", "bold red")
    if campaign["interrupted"]:
        asked = campaign["last_seed"] - campaign["first_seed"] + 1
        done = total["flights"] + len(campaign["not_flown"])
        print_line(f"Interrupted: {done} of {asked} flights are done.", "bold yellow")
    factor = total["real_time_factor"]
    if factor is not None:
        print_line(f"Flown in {total['wall_time_s']:.1f} s, {factor:.0f} times real time.")


def print_files(folder: object, names: Sequence[str]) -> None:
    """Print where the results are."""
    print_line(f"{folder}: {', '.join(names)}")


def _title(flown: Mapping[str, Any], seeds: str) -> Text:
    what = "plain propellers"
    if flown["conf"] is not None:
        what = f"Conf. {flown['conf']}, law {flown['law']}"
    if flown["model"]:
        what += f", model {flown['model']}"
    reaction = reaction_words(flown["reaction"])
    what += f", {reaction}" if reaction is not None else ""
    what += ", with disturbances" if flown["disturbances"] else ""
    return Text(f"{flown['scenario']}, {seeds} ({what})")


def _cell(row: Row, value: float | None, text: str | None) -> Text:
    if text is not None:
        return Text(text)
    return Text("–" if value is None else f"{fixed(value, row.digits)} {row.unit}".rstrip())


def _speed(flight: FlightResult) -> str:
    summary = flight.summary
    line = f"Flown in {summary['wall_time_s']:.3f} s"
    if summary["real_time_factor"] is not None:
        factor = summary["real_time_factor"]
        line += f", {factor:.{0 if factor >= 10 else 2}f} times real time"
    factor = flight.real_time_factor_with_recording
    if factor is not None and flight.recording_s is not None:
        line += (
            f"; {summary['recorded_messages']} messages recorded in {flight.recording_s:.3f} s, "
            f"together {factor:.0f} times"
        )
    return line + "."
