"""A question about risk as data: what is flown, with which inputs uncertain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from tombo_bag.flight import Flight
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_seed
from tombo_flight.flight_output import flight_summary
from tombo_flight.json_text import plain
from tombo_flight.process.study import StudiedScenario, read_scenario
from tombo_flight.risk.estimate import METHODS
from tombo_flight.risk.inputs import Input, openturns, parse_input, settings_at
from tombo_flight.risk.margin import margin
from tombo_flight.scenario import Scenario
from tombo_flight.vehicle_file import vehicle_named

FEWEST, MOST = 100, 10_000_000
"""Flights."""
_OWN_VEHICLE = "tombo_s500"
_KEYS = (
    *("scenario", "inputs", "flights", "method", "seed", "settings", "label", "values"),
    *("tombo_version", "model", "vehicle", "imports"),
)
"""Of `risk.json`, before the result."""


@dataclass(frozen=True, kw_only=True)
class RiskStudy(StudiedScenario):
    """A scenario, its uncertain inputs, and how many flights may be flown."""

    inputs: tuple[Input, ...]
    flights: int
    method: str
    seed: int
    """All draws follow from it."""

    def scenario_at(self, point: Sequence[str]) -> Scenario:
        """Return what is flown with the settings of a point.

        Raises:
            InputError: it is no scenario.
        """
        return self.scenario_with(point)

    def figures(self, flight: Flight, scenario: Scenario) -> dict[str, Any]:
        """Return the margin of a flight."""
        return {"margin": margin(flight_summary(flight), scenario)}

    def command(self, point: Array, seed: int) -> str:
        """Return the command line that flies a flight again."""
        return self.command_with(settings_at(self.inputs, point), seed)

    def as_mapping(self) -> dict[str, Any]:
        """Return it in the types of JSON."""
        values: dict[str, Any] = plain(asdict(self))
        return {key: values[key] for key in _KEYS}


def new_risk(
    scenario: str,
    given: Sequence[str],
    flights: int,
    method: str = METHODS[0],
    seed: int = 0,
    settings: Sequence[str] = (),
    model: str | None = None,
    vehicle: str | None = None,
) -> RiskStudy:
    """Read and check a question: the scenario, the inputs, and that they can be drawn.

    Args:
        scenario: name or file.
        given: texts of --given.
        flights: to be flown at most.
        method: one of `METHODS`.
        seed: all draws follow from it.
        settings: texts of --set.
        model: a model.yaml.
        vehicle: a name or file.

    Raises:
        InputError: as `load_scenario`, of an input, or a package is not installed.
    """
    openturns()
    check_seed("seed", seed)
    if method not in METHODS:
        raise unknown_name("--method", method, METHODS)
    if not FEWEST <= flights <= MOST:
        raise InputError(f"--flights {flights}: out of bounds; accepted: {FEWEST} to {MOST}")
    base = read_scenario(scenario, settings, model, vehicle)
    as_given = StudiedScenario(**base).scenario_with(())
    file = vehicle_named(vehicle or _OWN_VEHICLE)
    inputs = tuple(parse_input(text, as_given, file) for text in given)
    keys = [one.key for one in inputs]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"--given {key}: given twice; accepted: once")
    study = RiskStudy(**base, inputs=inputs, flights=flights, method=method, seed=seed)
    for one in inputs:
        for u in (-2.0, 0.0, 2.0):
            study.scenario_at([f"{one.key}={one.text_at(u)}"])
    return study
