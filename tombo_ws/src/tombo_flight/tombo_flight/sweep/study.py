"""A sweep as data: what is flown in which order, and the flight of a number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

from tombo_collision.own_reactions import imported_files
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import check_seed
from tombo_flight.command_line import fly_command
from tombo_flight.json_text import plain
from tombo_flight.scenario import Scenario, scenario_values, with_settings
from tombo_flight.sweep.columns import row_of
from tombo_flight.sweep.design import Design, Points
from tombo_flight.version import tombo_version

MOST_FLIGHTS = 10**9


@dataclass(frozen=True)
class Sweep:
    """A scenario, what is varied, and the seeds that each point is flown with.

    Flight n has point n // seeds and seed first + n % seeds.
    """

    scenario: str
    """Name or file, as given."""
    design: Design
    seeds: tuple[int, int]
    """First, and the one after the last."""
    settings: tuple[str, ...] = ()
    """Further texts of --set, the same for all points."""
    label: str = ""
    """Name of the scenario."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Of the scenario, complete: nothing is read again when the sweep goes on."""
    version: str = ""
    """Of the software."""
    model: str = ""
    vehicle: str = ""
    imports: tuple[tuple[str, str], ...] = ()
    """Files with the user's reactions, as of `imported_files`."""

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
        varied = [f"{key}={text}" for key, text in self.points[point].items()]
        return with_settings(dict(self.values), [*self.settings, *varied], self.label)

    def figures(self, summary: Mapping[str, Any], scenario: Scenario) -> dict[str, Any]:
        """Return the columns of a flight."""
        return row_of(summary)

    def command(self, flight: int) -> str:
        """Return the command line that flies a flight again."""
        point, seed = self.place(flight)
        varied = [f"{key}={text}" for key, text in self.points[point].items()]
        return fly_command(
            self.scenario,
            seed,
            settings=[*self.settings, *varied],
            model=self.model,
            vehicle=self.vehicle,
            imports=self.imports,
        )

    def as_mapping(self) -> dict[str, Any]:
        """Return it in the types of JSON: what `sweep.json` says."""
        values: dict[str, Any] = plain(asdict(self))
        design = values.pop("design")
        return {"tombo_version": values.pop("version"), **values, **design}


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
    values, label = scenario_values(scenario, model, vehicle)
    sweep = Sweep(
        scenario, design, (seeds.start, seeds.stop), settings, label, plain_values(values),
        tombo_version(), model or "", vehicle or "", imported_files(),
    )  # fmt: skip
    if not 1 <= sweep.flights <= MOST_FLIGHTS:
        raise InputError(f"{sweep.flights} flights; accepted: 1 to {MOST_FLIGHTS}")
    sweep.scenario_at(0)
    for axis in design.axes:
        for text in axis.ends:
            with_settings(values, [*settings, f"{axis.key}={text}"], label)
    return sweep


def plain_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of a scenario in the types of JSON, tuples as lists."""
    found: dict[str, Any] = plain(values)
    return found
