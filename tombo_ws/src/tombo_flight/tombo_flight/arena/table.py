"""The table of an arena: the same cells on the page, on the terminal and in the documentation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from tombo_flight.arena.cases import COLLISIONS, FREE

HEAD: Final = (
    *("reaction", "crashed", "recovered", "fall [m]", "unstable [s]", "recovery [s]"),
    *("strikes", "peak force [N]", "known, 95 % [ms]", "rotor right", "false alarms/h"),
)
MEANING: Final = (
    "Crashed: share of the flights, with its exact 95 % interval. Fall, unstable and recovery: "
    "median, and 5 to 95 % of the flights that have the figure. Strikes: mean of a flight. Peak "
    "force: largest of the obstacle on the vehicle, median. Known: from touch until the reaction "
    "knows of it, 95th percentile. Rotor right: of the flights in which the reaction named a "
    "rotor. Definitions: docs/figures.md."
)
Result = Mapping[str, Any]


def table_rows(
    results: Mapping[str, Any], groups: Sequence[str] = (COLLISIONS, FREE)
) -> Iterator[tuple[str, list[list[str]]]]:
    """Yield each case of some groups with its rows, one a reaction, in the columns of `HEAD`."""
    shown = [r for r in results["results"] if r["group"] in groups]
    for case in dict.fromkeys(r["case"] for r in shown):
        yield case, [cells(r) for r in shown if r["case"] == case]


def markdown(results: Mapping[str, Any], command: str) -> str:
    """Return the table of the collisions as Markdown, below the command that it comes from."""
    head = ("collision", *HEAD)
    lines = [f"`{command}`:", "", f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for case, rows in table_rows(results):
        for i, row in enumerate(rows):
            lines.append(f"| {case if i == 0 else ''} | {' | '.join(row)} |")
    return "\n".join(lines) + "\n"


def cells(result: Result) -> list[str]:
    """Return the cells of a row."""
    return [
        str(result["reaction"]),
        crashed(result),
        f"{result['recovered']} of {result['collided']}" if result["collided"] else "–",
        _spread(result["max_falling_distance_m"]),
        _spread(result["unstable_phase_s"]),
        _spread(result["recovery_time_s"]),
        _figure(result["strikes"]["mean"], 1),
        _figure(result["peak_contact_force_n"]["median"], 0),
        _figure(result["contact_known_s"]["p95"], 0, 1e3),
        _right(result),
        _figure(result["false_alarms_per_hour"], 2),
    ]


def crashed(result: Result) -> str:
    """Return how many of the flights crashed, with the interval of the rate."""
    if not result["flights"]:
        return "–"
    low, high = (100.0 * end for end in result["crash_rate_95"])
    return f"{result['crashed']} of {result['flights']} ({low:.1f} to {high:.1f} %)"


def _right(result: Result) -> str:
    share = result["struck_rotor_right"]
    named = result["struck_rotor_named"]
    return "–" if share is None else f"{100.0 * share:.1f} % of {named}"


def _spread(values: Mapping[str, float | None]) -> str:
    if not values["count"]:
        return "–"
    median, low, high = (_figure(values[key], 2) for key in ("median", "p05", "p95"))
    return f"{median} ({low} to {high})"


def _figure(value: float | None, digits: int, factor: float = 1.0) -> str:
    return "–" if value is None else f"{factor * value:.{digits}f}"
