"""One scenario flown with many seeds, on all cores; each flight as if it were alone."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from tombo_dynamics.errors import InputError
from tombo_flight.campaign.statistics import aggregate
from tombo_flight.flight_output import flight_summary
from tombo_flight.process.study import fly_seeds
from tombo_flight.scenario import Scenario
from tombo_flight.version import tombo_version


def fly_campaign(
    scenario: Scenario,
    seeds: range,
    *,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[str, Any]:
    """Fly a scenario with each of the seeds and return the campaign's summary.

    The order of the flights is that of the seeds, whichever process flew them. A campaign that is
    stopped holds the flights up to the first one missing.

    Args:
        scenario: what to fly; `flight_output.warm_up_flight` it first.
        seeds: the seeds.
        workers: number of processes; the cores that this process may use if None.
        progress: called with the number of flights done.
        stop: asked ten times a second; True ends all processes and the campaign.

    Returns:
        scenario, model, conf, law, reaction, disturbances, first_seed, last_seed, tombo_version,
        interrupted, `flights` (summaries, see `flight_output`), `not_flown` (seed and error of
        flights that can't be) and `aggregate` of `flights` (see `campaign.statistics`).

    Raises:
        InputError: as `fly_scenario`, with the seed, where no flight can be flown.
    """
    began = time.perf_counter()
    flown = fly_seeds(
        scenario, seeds, flight_summary, workers=workers, progress=progress, stop=stop
    )
    wall = time.perf_counter() - began
    flights = [row for row in flown.values() if "error" not in row]
    not_flown = [{"seed": seed, **row} for seed, row in flown.items() if "error" in row]
    if not_flown and not flights:
        raise InputError(f"seed {not_flown[0]['seed']}: {not_flown[0]['error']}")
    return {
        "tombo_version": tombo_version(),
        "scenario": scenario.name,
        "model": scenario.model or None,
        "conf": None if scenario.propeller.plain else scenario.propeller.conf,
        "law": None if scenario.propeller.plain else scenario.propeller.law,
        "reaction": scenario.reaction.name,
        "disturbances": scenario.disturbances,
        "first_seed": seeds[0],
        "last_seed": seeds[-1],
        "interrupted": len(flown) < len(seeds),
        "flights": flights,
        "not_flown": not_flown,
        "aggregate": aggregate(flights, wall),
    }
