"""A sweep as data: what is flown in which order, and the flight of a number."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from tombo_bag.flight import Flight
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import check_seed
from tombo_flight.flight_output import flight_summary
from tombo_flight.json_text import plain
from tombo_flight.process.study import StudiedScenario, read_scenario
from tombo_flight.scenario import Scenario
from tombo_flight.sweep.columns import row_of
from tombo_flight.sweep.design import Design, Points

MOST_FLIGHTS = 10**9
_KEYS = (
    *("tombo_version", "scenario", "seeds", "settings", "label", "values", "model", "vehicle"),
    "imports",
)
"""Of `sweep.json`, with those of the design."""


@dataclass(frozen=True, kw_only=True)
class Sweep(StudiedScenario):
    """A scenario, what is varied, and the seeds that each point is flown with.

    Flight n has point n // seeds and seed first + n % seeds.
    """

    design: Design
    seeds: tuple[int, int]
    """First, and the one after the last."""

    @property
    def flights(self) -> int:
        """How many flights there are."""
        return self.design.points * (self.seeds[1] - self.seeds[0])

    @cached_property
    def points(self) -> Points:
        """The settings of each point."""
        return self.design.settings()

    def place(self, flight: int) -> tuple[int, int]:
        """Return point and seed of a flight."""
        point, seed = divmod(flight, self.seeds[1] - self.seeds[0])
        return point, self.seeds[0] + seed

    def scenario_at(self, point: int) -> Scenario:
        """Return what is flown at a point.

        Raises:
            InputError: it is no scenario.
        """
        return self.scenario_with(self._varied(point))

    def _varied(self, point: int) -> list[str]:
        return [f"{key}={text}" for key, text in self.points[point].items()]

    def figures(self, flight: Flight, scenario: Scenario) -> dict[str, Any]:
        """Return the columns of a flight."""
        return row_of(flight_summary(flight))

    def command(self, flight: int) -> str:
        """Return the command line that flies a flight again."""
        point, seed = self.place(flight)
        return self.command_with(self._varied(point), seed)

    def as_mapping(self) -> dict[str, Any]:
        """Return it in the types of JSON: what `sweep.json` says."""
        values: dict[str, Any] = plain(asdict(self))
        return {**{key: values[key] for key in _KEYS}, **values["design"]}


def new_sweep(
    scenario: str,
    design: Design,
    seeds: range,
    settings: tuple[str, ...] = (),
    model: str | None = None,
    vehicle: str | None = None,
) -> Sweep:
    """Read and check a sweep: the scenario, and each value of an axis by itself.

    Raises:
        InputError: as `load_scenario`, or there are too many flights.
    """
    for seed in (seeds.start, seeds.stop - 1) if seeds else ():
        check_seed("seed", seed)
    base = read_scenario(scenario, settings, model, vehicle)
    sweep = Sweep(**base, design=design, seeds=(seeds.start, seeds.stop))
    if not 1 <= sweep.flights <= MOST_FLIGHTS:
        raise InputError(f"{sweep.flights} flights; accepted: 1 to {MOST_FLIGHTS}")
    sweep.scenario_at(0)
    for axis in design.axes:
        for text in axis.ends:
            sweep.scenario_with([f"{axis.key}={text}"])
    return sweep
