"""The figures of an arena: statistics of each reaction in each case."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from tombo_flight.arena.cases import COLLISIONS, GROUPS, Match
from tombo_flight.arena.flying import Plan, Row
from tombo_flight.campaign.statistics import flight_statistics
from tombo_flight.version import tombo_version

TYPICAL: Final = "typical"
WORST: Final = "worst"


def arena_results(plan: Plan, kept: Mapping[str, Row], seeds: range) -> dict[str, Any]:
    """Return the content of `arena.json`.

    Args:
        plan: what was flown.
        kept: the rows of all its flights.
        seeds: of the cases that fly all of them.

    Returns:
        tombo_version, disturbances, first_seed, last_seed, reactions; `refused`: what could
        not be flown, and why; `results`: of each reaction in each case reaction, case, group,
        place in its map, the command of its first flight, and what `flight_statistics` returns;
        `collisions` and `all_cases`: what that returns for all flights of a reaction in
        COLLISIONS, and in all groups; `shown`: what `shown_flights` returns for each reaction.
    """
    reactions = list(dict.fromkeys(match.reaction for match in plan.matches))
    rows = plan.rows(kept)
    return {
        "tombo_version": tombo_version(),
        "disturbances": plan.matches[0].disturbed if plan.matches else None,
        "first_seed": seeds[0],
        "last_seed": seeds[-1],
        "reactions": reactions,
        "refused": {**plan.refused, **plan.not_flown(kept)},
        "results": [
            _result(match, of, match.case.seeds(seeds)[0]) for match, of in rows.items() if of
        ],
        "collisions": {name: _pooled(name, rows, (COLLISIONS,)) for name in reactions},
        "all_cases": {name: _pooled(name, rows, GROUPS) for name in reactions},
        "shown": [one for name in reactions for one in shown_flights(name, rows)],
    }


def _pooled(
    reaction: str, rows: Mapping[Match, Sequence[Row]], groups: Iterable[str]
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


def _result(match: Match, rows: Sequence[Row], seed: int) -> dict[str, Any]:
    case = match.case
    return {
        "reaction": match.reaction,
        "case": case.name,
        "group": case.group,
        "place": list(case.place),
        "command": match.command(seed),
        **flight_statistics(rows),
    }


def shown_flights(reaction: str, rows: Mapping[Match, Sequence[Row]]) -> list[dict[str, Any]]:
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
    by_fall = sorted(flown, key=lambda one: float(one[1]["max_falling_distance_m"]))
    chosen = {
        TYPICAL: by_fall[(len(by_fall) - 1) // 2],
        WORST: max(by_fall, key=lambda one: (one[1]["crashed"], one[1]["max_falling_distance_m"])),
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
