"""A question about risk as data: what is flown, with which inputs uncertain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from tombo_collision.own_reactions import imported_files
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_seed
from tombo_flight.command_line import fly_command
from tombo_flight.json_text import plain
from tombo_flight.risk.estimate import METHODS
from tombo_flight.risk.inputs import Input, openturns, parse_input, settings_at
from tombo_flight.risk.margin import margin
from tombo_flight.scenario import Scenario, scenario_values, with_settings
from tombo_flight.vehicle_file import vehicle_named
from tombo_flight.version import tombo_version

FEWEST, MOST = 100, 10_000_000
"""Flights."""
_OWN_VEHICLE = "tombo_s500"


@dataclass(frozen=True)
class RiskStudy:
    """A scenario, its uncertain inputs, and how many flights may be flown."""

    scenario: str
    """Name or file, as given."""
    inputs: tuple[Input, ...]
    flights: int
    method: str
    seed: int
    """All draws follow from it."""
    settings: tuple[str, ...]
    """Texts of --set, the same for all flights."""
    label: str
    """Name of the scenario."""
    values: Mapping[str, Any]
    """Of the scenario, complete: nothing is read again when the study goes on."""
    tombo_version: str
    model: str = ""
    vehicle: str = ""
    imports: tuple[tuple[str, str], ...] = ()
    """Files with the user's reactions, as of `imported_files`."""

    def scenario_at(self, settings: Sequence[str]) -> Scenario:
        """Return what is flown with further settings.

        Raises:
            InputError: it is no scenario.
        """
        return with_settings(dict(self.values), [*self.settings, *settings], self.label)

    def figures(self, summary: Mapping[str, Any], scenario: Scenario) -> dict[str, Any]:
        """Return the margin of a flight."""
        return {"margin": margin(summary, scenario)}

    def command(self, point: Array, seed: int) -> str:
        """Return the command line that flies a flight again."""
        return fly_command(
            self.scenario,
            seed,
            settings=[*self.settings, *settings_at(self.inputs, point)],
            model=self.model,
            vehicle=self.vehicle,
            imports=self.imports,
        )

    def as_mapping(self) -> dict[str, Any]:
        """Return it in the types of JSON."""
        found: dict[str, Any] = plain(asdict(self))
        return found


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
    values, label = scenario_values(scenario, model, vehicle)
    values = plain(values)
    base = with_settings(values, settings, label)
    file = vehicle_named(vehicle or _OWN_VEHICLE)
    inputs = tuple(parse_input(text, base, file) for text in given)
    keys = [one.key for one in inputs]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"--given {key}: given twice; accepted: once")
    study = RiskStudy(
        scenario, inputs, flights, method, seed, tuple(settings), label, values, tombo_version(),
        model or "", vehicle or "", imported_files(),
    )  # fmt: skip
    for one in inputs:
        for u in (-2.0, 0.0, 2.0):
            study.scenario_at([f"{one.key}={one.text_at(u)}"])
    return study
