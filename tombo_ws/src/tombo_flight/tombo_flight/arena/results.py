"""The figures of an arena: of each reaction in each case, as values and as cells of a table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from tombo_flight.arena.study import COLLISIONS, FREE, GROUPS, ArenaStudy, Match
from tombo_flight.campaign.statistics import flight_statistics
from tombo_flight.process.study import FlightRow
from tombo_flight.version import tombo_version

TYPICAL: Final = "typical"
WORST: Final = "worst"


def arena_results(study: ArenaStudy, kept: Mapping[str, FlightRow]) -> dict[str, Any]:
    """Return the content of `arena.json`.

    Args:
        study: what was flown.
        kept: the rows of all its flights.

    Returns:
        tombo_version, disturbances, first_seed, last_seed, reactions; `refused`: what could
        not be flown, and why; `results`: of each reaction in each case reaction, case, group,
        place in its map, the command of its first flight, and what `flight_statistics` returns;
        `collisions` and `all_cases`: what that returns for all flights of a reaction in
        COLLISIONS, and in all groups; `shown`: what `shown_flights` returns for each reaction.
    """
    reactions = list(dict.fromkeys(match.reaction for match in study.matches))
    rows = study.rows(kept)
    return {
        "tombo_version": tombo_version(),
        "disturbances": study.matches[0].disturbed if study.matches else None,
        "first_seed": study.seeds[0],
        "last_seed": study.seeds[-1],
        "reactions": reactions,
        "refused": {**study.refused, **study.not_flown(kept)},
        "results": [
            _result(match, of, match.case.seeds(study.seeds)[0])
            for match, of in rows.items()
            if of
        ],
        "collisions": {name: _pooled(name, rows, (COLLISIONS,)) for name in reactions},
        "all_cases": {name: _pooled(name, rows, GROUPS) for name in reactions},
        "shown": [flight for name in reactions for flight in shown_flights(name, rows)],
    }


def _pooled(
    reaction: str, rows: Mapping[Match, Sequence[FlightRow]], groups: Iterable[str]
) -> dict[str, Any]:
    within = list(groups)
    return flight_statistics(
        [
            row
            for match, of in rows.items()
            for row in of
            if match.reaction == reaction and match.case.group in within
        ]
    )


def _result(match: Match, rows: Sequence[FlightRow], seed: int) -> dict[str, Any]:
    case = match.case
    return {
        "reaction": match.reaction,
        "case": case.name,
        "group": case.group,
        "place": list(case.place),
        "command": match.command(seed),
        **flight_statistics(rows),
    }


def shown_flights(
    reaction: str, rows: Mapping[Match, Sequence[FlightRow]]
) -> list[dict[str, Any]]:
    """Return which flights of a reaction stand for it, of those that touched in COLLISIONS.

    The typical one has the median of the largest falling distance, the lower one of two. The
    worst one crashed, if one did; of several it fell farthest.

    Returns:
        `kind`, typical or worst, reaction, case, seed, command, and the flight's figures.
    """
    flown = [
        (match, row)
        for match, of in rows.items()
        for row in of
        if match.reaction == reaction
        and match.case.group == COLLISIONS
        and row["max_falling_distance_m"] is not None
    ]
    if not flown:
        return []
    by_fall = sorted(flown, key=lambda flight: float(flight[1]["max_falling_distance_m"]))
    chosen = {
        TYPICAL: by_fall[(len(by_fall) - 1) // 2],
        WORST: max(
            by_fall, key=lambda flight: (flight[1]["crashed"], flight[1]["max_falling_distance_m"])
        ),
    }
    return [
        {
            "kind": kind,
            "reaction": reaction,
            "case": match.case.name,
            "command": match.command(int(row["seed"])),
            **row,
        }
        for kind, (match, row) in chosen.items()
    ]


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
        crashed_text(result),
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


def crashed_text(result: Result) -> str:
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
