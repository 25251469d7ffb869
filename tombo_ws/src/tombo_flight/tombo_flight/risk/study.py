"""A question about risk as data: a scenario, its uncertain inputs, and the margin of a flight."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from scipy.special import ndtr

from tombo_bag.flight import Flight
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_seed
from tombo_dynamics.vehicle import GRAVITY
from tombo_flight.json_text import plain
from tombo_flight.process.study import StudiedScenario, read_scenario
from tombo_flight.risk.estimate import METHODS
from tombo_flight.scenario import Scenario
from tombo_flight.sweep.study import number_text
from tombo_flight.vehicle_file import EFFECT_OF, VehicleFile, vehicle_named
from tombo_sim.propeller_effects import vehicle_effects

DISTRIBUTIONS = {
    "Normal": "mean, deviation",
    "Uniform": "a, b",
    "LogNormal": "muLog, sigmaLog",
    "Triangular": "a, mode, b",
    "TruncatedNormal": "mean, deviation, a, b",
    "Beta": "alpha, beta, a, b",
    "Gamma": "k, lambda",
    "Exponential": "lambda",
    "WeibullMin": "beta, alpha",
    "Gumbel": "beta, gamma",
    "Laplace": "mu, lambda",
}
"""Names and parameters of OpenTURNS."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_CALL = re.compile(rf"(\w+)\(\s*({_NUMBER}(?:\s*,\s*{_NUMBER})*)\s*\)")
_ACCEPTED = "accepted: KEY or KEY~DISTRIBUTION(..), as in 'vehicle.mass~Normal(1.3,0.02)'"
_MOST_OUTSIDE = 1e-6
"""Probability beyond the bounds of a setting that is cut off; more is refused."""


@dataclass(frozen=True)
class Input:
    """One uncertain setting."""

    key: str
    """As of --set: "vehicle.mass"."""
    distribution: str
    """As text: "Normal(1.3,0.02)"."""
    source: str
    """Where the distribution is from."""
    bounds: tuple[float, float]
    """That the setting accepts."""

    @cached_property
    def made(self) -> Any:
        """The distribution of OpenTURNS, within the bounds of the setting.

        Raises:
            InputError: it has no such parameters, or goes beyond the bounds.
        """
        ot = openturns()
        found = _CALL.fullmatch(self.distribution)
        given = f"{self.key}~{self.distribution}"
        if found is None:
            raise InputError(f"--given '{given}': {_ACCEPTED}")
        name, numbers = found[1], [float(text) for text in found[2].split(",")]
        if name not in DISTRIBUTIONS:
            raise unknown_name(f"distribution in --given '{given}':", name, DISTRIBUTIONS)
        if len(numbers) != len(DISTRIBUTIONS[name].split(",")):
            raise InputError(f"--given '{given}': accepted: {name}({DISTRIBUTIONS[name]})")
        try:
            made = getattr(ot, name)(*numbers)
        except (TypeError, RuntimeError) as error:
            raise InputError(
                f"--given '{given}': {str(error).partition(' : ')[2] or error}; accepted: "
                f"{name}({DISTRIBUTIONS[name]})"
            ) from None
        low, high = self.bounds
        outside = made.computeCDF(low) * (low > made.getRange().getLowerBound()[0])
        outside += made.computeComplementaryCDF(high)
        if outside > _MOST_OUTSIDE:
            raise InputError(
                f"--given '{given}': {outside:.2g} of it is outside {low:g} to {high:g}, the "
                f"bounds of {self.key}; accepted: {_MOST_OUTSIDE:g} at most, as with "
                "TruncatedNormal(mean,deviation,a,b)"
            )
        return ot.TruncatedDistribution(made, low, high) if outside > 0.0 else made

    def text_at(self, u: float) -> str:
        """Return the value for a standard normal number, as --set reads it."""
        value = self.made.computeScalarQuantile(float(ndtr(-abs(u))), u > 0.0)
        return number_text(min(max(value, self.bounds[0]), self.bounds[1]))


def settings_at(inputs: Sequence[Input], point: Array) -> list[str]:
    """Return the settings of a point (d,) of standard normal numbers, as texts of --set."""
    return [
        f"{setting.key}={setting.text_at(float(u))}"
        for setting, u in zip(inputs, point, strict=True)
    ]


def openturns() -> Any:
    """Return the module.

    Raises:
        InputError: it is not installed.
    """
    try:
        import openturns as ot
    except ImportError as error:
        raise InputError(
            f"tombo risk: {error.name} is not installed; accepted: after "
            "pip install -r requirements-study.txt"
        ) from None
    return ot


def parse_input(text: str, scenario: Scenario, vehicle: VehicleFile) -> Input:
    """Return the input that `KEY~DISTRIBUTION(..)` or `KEY` means.

    Args:
        text: as given.
        scenario: in which the key is.
        vehicle: whose tolerances are the default.

    Raises:
        InputError: the key is unknown or no number, or there is no default.
    """
    key, sign, rest = (part.strip() for part in text.partition("~"))
    if not key or (sign and not rest):
        raise InputError(f"--given '{text}': {_ACCEPTED}")
    bounds, value = _number_at(scenario, key)
    if rest:
        found = Input(key, re.sub(r"\s", "", rest), "given", bounds)
    else:
        deviation, source = _tolerance(key, value, vehicle)
        distribution = f"Normal({value:.9g},{deviation:.6g})"
        found = Input(key, distribution, source, bounds)
    _ = found.made
    return found


def _number_at(scenario: Scenario, key: str) -> tuple[tuple[float, float], float]:
    """Return bounds and value of a setting that is a number."""
    *path, name = key.split(".")
    if path[:1] == ["effects"] and len(path) == 2:
        if path[1] not in REGISTRY:
            raise unknown_name("effect in --given", path[1], REGISTRY)
        theta = {param.name: param for param in REGISTRY[path[1]].theta}
        if name not in theta:
            raise unknown_name(f"parameter of effects.{path[1]} in --given", name, theta)
        effects = vehicle_effects(scenario.propeller, scenario.vehicle, scenario.effects)
        value = effects.get(path[1], {}).get(name, theta[name].null)
        return theta[name].bounds, float(value)
    record: Any = scenario
    for part in path:
        record = getattr(record, part, None)
    fields = dataclasses.fields(record) if dataclasses.is_dataclass(record) else ()
    numbers = {f.name: f for f in fields if "bounds" in f.metadata}
    if name not in numbers or getattr(record, name) is None:
        inside = [f"{'.'.join(path)}.{field}".lstrip(".") for field in numbers]
        sections = [
            f.name for f in dataclasses.fields(scenario)
            if dataclasses.is_dataclass(getattr(scenario, f.name))
        ]  # fmt: skip
        raise unknown_name("setting in --given", key, inside or [*sections, "effects"])
    return numbers[name].metadata["bounds"], float(getattr(record, name))


def _tolerance(key: str, value: float, vehicle: VehicleFile) -> tuple[float, str]:
    """Return the standard deviation with which a value is known, and where that is from."""
    noted = vehicle.tolerance(key)
    if noted is not None:
        return noted, f"tolerance in the file of {vehicle.name}"
    label, share = EFFECT_OF.get(key, (key.removeprefix("effects."), False))
    effect, _, name = label.partition(".")
    for param in REGISTRY[effect].theta if effect in REGISTRY else ():
        if param.name == name:
            usual = REGISTRY[effect].tolerance(param) * (abs(value) if share else 1.0)
            return usual, f"usual tolerance, that of effects.{label}"
    raise InputError(
        f"--given '{key}': no tolerance of it is known; accepted: with a distribution, as in "
        f"'{key}~Normal({value:g},..)'"
    )


_LEAST = 1e-6
"""Of a flight without a crash: the boundary itself belongs to the crashes."""


def margin(summary: Mapping[str, Any], scenario: Scenario) -> float:
    """Return the margin to a crash, from -1 to 1; below 0 exactly where the flight crashed.

    Without a crash: the smaller of the height that was left above the ground, as a share of that
    at contact, and of the angle that was left to upside down, as a share of pi. After one: minus
    the time of a free fall from that height over the time from contact (from the start without
    one) to the crash, so that it goes to 0 as the crash comes later.

    Args:
        summary: of the flight (docs/figures.md); no log is needed.
        scenario: what was flown.
    """
    legs = scenario.vehicle.leg_height
    contact = summary["contact_position_m"]
    begun = scenario.mission.height if contact is None else float(contact[2])
    height = max(begun - legs, _LEAST)
    if summary["crashed"]:
        lasted = float(summary["crash_time_s"] - (summary["collision_time_s"] or 0.0))
        if lasted <= 0.0:  # it was down, or turned over, before it touched the obstacle
            lasted = float(summary["crash_time_s"])
        return -min(math.sqrt(2.0 * height / GRAVITY) / max(lasted, _LEAST), 1.0)
    left = [1.0]
    if summary["max_tilt_rad"] is not None:
        left.append(1.0 - summary["max_tilt_rad"] / math.pi)
    if summary["max_falling_distance_m"] is not None:
        left.append(1.0 - summary["max_falling_distance_m"] / height)
    return max(min(left), _LEAST)


FEWEST, MOST = 100, 10_000_000
"""Flights."""
_OWN_VEHICLE = "tombo_s500"
_KEYS = (
    *("scenario", "inputs", "flights", "method", "seed", "settings", "label", "values"),
    *("tombo_version", "model", "vehicle", "imports"),
)
"""Of `risk.json`, before the result: those of the estimate, not how far it is checked."""


@dataclass(frozen=True, kw_only=True)
class RiskStudy(StudiedScenario):
    """A scenario, its uncertain inputs, and how many flights may be flown."""

    kind = "risk"
    summary_only = True
    inputs: tuple[Input, ...]
    flights: int
    method: str
    seed: int
    """All draws follow from it."""
    check: int = 0
    """Further flights, drawn as given, by which the estimate is checked."""

    def scenario_at(self, point: Sequence[str]) -> Scenario:
        """Return what is flown with the settings of a point.

        Raises:
            InputError: it is no scenario.
        """
        return self.scenario_with(point)

    @property
    def keys(self) -> range:
        """The keys of its flights."""
        return range(self.flights + self.check)

    def columns(self) -> dict[str, str]:
        """Return the columns of the table that flights have by themselves."""
        inputs = dict.fromkeys([setting.key for setting in self.inputs], "number")
        place = dict.fromkeys(("flight", "seed"), "count")
        return {**place, **inputs, "margin": "number", "error": "text"}

    def labels(self, point: Sequence[str]) -> dict[str, float]:
        """Return the inputs of a flight."""
        return {key: float(value) for key, _, value in (text.partition("=") for text in point)}

    def figures(self, flight: Flight, scenario: Scenario) -> dict[str, Any]:
        """Return the margin of a flight."""
        return {"margin": margin(flight.summary, scenario)}

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
    check: int | None = None,
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
        check: further flights, drawn as given, that check the estimate.

    Raises:
        InputError: as `load_scenario`, of an input, or a package is not installed.
    """
    openturns()
    check_seed("seed", seed)
    if method not in METHODS:
        raise unknown_name("--method", method, METHODS)
    for option, number in (("--flights", flights), ("--check", check)):
        if number is not None and not FEWEST <= number <= MOST:
            raise InputError(f"{option} {number}: out of bounds; accepted: {FEWEST} to {MOST}")
    base = read_scenario(scenario, settings, model, vehicle)
    as_given = StudiedScenario(**base).scenario_with(())
    file = vehicle_named(vehicle or _OWN_VEHICLE)
    inputs = tuple(parse_input(text, as_given, file) for text in given)
    keys = [setting.key for setting in inputs]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"--given {key}: given twice; accepted: once")
    study = RiskStudy(
        **base, inputs=inputs, flights=flights, method=method, seed=seed, check=check or 0
    )
    for setting in inputs:
        for u in (-2.0, 0.0, 2.0):
            study.scenario_at([f"{setting.key}={setting.text_at(u)}"])
    return study
