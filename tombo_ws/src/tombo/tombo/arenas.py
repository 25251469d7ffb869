"""Every reaction against a set of collisions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from tombo_dynamics.errors import InputError


def arena(
    seeds: range = range(30),
    reactions: Sequence[str] | None = None,
    groups: Sequence[str] | None = None,
    *,
    clean: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Fly reactions against a set of collisions: what `tombo arena` does, without its files.

    Args:
        seeds: each case is flown with each of them, the maps with a third; without a step.
        reactions: names, your own too (`tombo.import_reactions`); policy:FILE flies the network of
            FILE. None: all that are compared.
        groups: of collisions, free, configurations, speed_offset, angle_radius. None: all.
        clean: without the disturbances.
        workers: processes on this machine; all cores if None.
        progress: called with the number of flights done, and of all.

    Returns:
        What `arena.json` says: `results` has a row for each reaction in each case, for
        `pandas.DataFrame`; `refused` says what could not be flown, and why.

    Raises:
        InputError: an unknown name, a policy without a network, or no seeds.
    """
    from tombo_flight.arena.cases import GROUPS, arena_cases, chosen, chosen_reactions
    from tombo_flight.arena.flying import fly_plan, new_plan
    from tombo_flight.arena.results import arena_results
    from tombo_flight.json_text import plain

    if not seeds or seeds.step != 1 or seeds.start < 0:
        raise InputError(f"seeds: {seeds}; accepted: a range from 0 or more with step 1")
    names = chosen_reactions(reactions, "reactions")
    within = chosen(groups, "groups", GROUPS)
    cases = [case for case in arena_cases() if case.group in within]
    plan = new_plan(names, cases, seeds, disturbed=not clean)
    kept: dict[str, dict[str, Any]] = {}
    fly_plan(plan, kept, workers=workers, progress=progress)
    results: dict[str, Any] = plain(arena_results(plan, kept, seeds))
    return results
