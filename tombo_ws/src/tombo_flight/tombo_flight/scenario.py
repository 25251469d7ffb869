"""Scenario files: what to fly, with what, against what; read, checked, and overridden by key."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from tombo_collision.params import TRIGGERS, DetectorParams
from tombo_collision.reactions import DEFAULT, Reaction, reaction_from_mapping
from tombo_collision.reactions.bounce import Bounce
from tombo_collision.reactions.none import NoReaction
from tombo_collision.reactions.policy import Policy
from tombo_control.params import ControlParams, EstimatorParams
from tombo_control.planning.mission import MissionParams
from tombo_control.recovery.params import ContactParams, RecoveryParams
from tombo_control.safety.flight_volume import check_volume
from tombo_control.safety.params import FlightVolume, SafetyParams
from tombo_dynamics.effects import check_theta
from tombo_dynamics.effects.registry import effects_for
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number, from_mapping, param
from tombo_dynamics.propeller import LAWS
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_vehicle
from tombo_dynamics.vehicle import VehicleParams
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.builtin_files import SCENARIOS, VEHICLES, builtin_file, builtin_scenarios
from tombo_flight.course_limits import check_course
from tombo_flight.extended_model import merge_effects, read_model
from tombo_flight.vehicle_file import VehicleFile, vehicle_named
from tombo_sim.world import ObstacleParams, SpreadParams, World

DEFAULT_SCENARIO = "paper_collision"


@dataclass(frozen=True)
class Scenario:
    """One experiment, complete and checked."""

    name: str = DEFAULT_SCENARIO
    description: str = ""
    duration: float = param(60.0, "s", (0.1, 3600.0), "the flight is cut off at this time")
    model: str = ""
    """Extended model whose effects update the scenario's; empty: none."""
    disturbances: bool = False
    """The disturbances of `scenarios/layers/disturbances.yaml` were added."""
    propeller: PropellerChoice = field(default_factory=PropellerChoice)
    vehicle: VehicleParams = field(default_factory=VehicleParams)
    control: ControlParams = field(default_factory=ControlParams)
    recovery: RecoveryParams = field(default_factory=RecoveryParams)
    contact: ContactParams = field(default_factory=ContactParams)
    estimator: EstimatorParams = field(default_factory=EstimatorParams)
    mission: MissionParams = field(default_factory=MissionParams)
    detector: DetectorParams = field(default_factory=DetectorParams)
    reaction: Reaction = field(default_factory=Bounce)
    obstacle: ObstacleParams = field(default_factory=ObstacleParams)
    spread: SpreadParams = field(default_factory=SpreadParams)
    safety: SafetyParams = field(default_factory=SafetyParams)
    volume: FlightVolume = field(default_factory=FlightVolume)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


_TOMBO_KEYS = ("propeller.conf", "propeller.law", "propeller.library")
"""Settings that choose a Tombo propeller."""
_ALWAYS_SAID = ("conf", "law", "library")
"""Keys of a propeller that a flown scenario states even where they have their defaults."""
_SECTIONS: dict[str, Any] = {
    each.name: each.default_factory
    for each in dataclasses.fields(Scenario)
    if each.default_factory is not dataclasses.MISSING and each.name not in ("reaction", "effects")
}


def _text_of(name: str, folder: Path) -> tuple[str, Path | None]:
    """Return the text of a scenario, and its file; None for a built-in one, whose name wins."""
    if (source := builtin_file(SCENARIOS, name)) is not None:
        return source.read_text(encoding="utf-8"), None
    path = folder / name
    if not path.is_file():
        if path.suffix not in (".yaml", ".yml"):
            raise unknown_name("scenario", name, builtin_scenarios())
        raise InputError(f"scenario file '{name}' does not exist; accepted: a YAML file")
    return read_text(path, f"scenario file '{name}'"), path.resolve()


def _read(
    name: str, folder: Path = Path(), below: tuple[Path | None, ...] = ()
) -> tuple[dict[str, Any], str]:
    """Return the content of a scenario by name or path, merged with its base.

    Args:
        name: built-in name or path.
        folder: base of a relative path: the folder of the file that extends this one.
        below: the files that extend this one, directly or not.
    """
    text, path = _text_of(name, folder)
    beside = SCENARIOS if path is None else path.parent
    if path is not None and path in below:
        raise InputError(f"scenario '{name}': extends itself")
    values = parse_yaml(text, f"scenario '{name}'")
    values = _files_beside(values, beside)
    whole = _extended(values, name, path.parent if path else folder, (*below, path))
    return whole, name if path is None else path.stem


def _files_beside(values: Any, folder: Path) -> Any:
    """Return a file's content with the paths in it relative to the file's folder."""
    if not isinstance(values, dict):
        return values
    found = dict(values)
    for section, key in (("reaction", "network"), ("propeller", "library"), ("mission", "course")):
        path = _section(values, section).get(key)
        if isinstance(path, str) and path and "\n" not in path:
            found[section] = {**values[section], key: str(folder / path)}
    vehicle = values.get("vehicle")
    if isinstance(vehicle, str) and builtin_file(VEHICLES, vehicle) is None:
        found["vehicle"] = str(folder / vehicle)
    return found


def _with_vehicle(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values whose vehicle, where it is a name or a path, is read.

    Its propeller and its gains are flown in place of the scenario's; limits of the scenario's
    control stay, forces among its effects take the vehicle's size, and the vehicle's own effects
    win over them.
    """
    name = values.get("vehicle")
    if not isinstance(name, str | VehicleFile):
        return dict(values)
    file = vehicle_named(name)
    found = dict(values)
    for section in ("vehicle", "propeller", "control"):
        found[section] = dataclasses.asdict(getattr(file, section))
    control = values.get("control")
    if isinstance(control, Mapping):
        kept = {k: v for k, v in control.items() if f"control.{k}" not in file.given}
        found["control"] |= kept
    effects = values.get("effects")
    if isinstance(effects, Mapping):
        scenario_from_mapping({"effects": effects}, file.name)  # refuses unknown effects
        found["effects"] = {**effects_for(effects, file.vehicle), **file.effects}
    elif effects is None:
        found["effects"] = dict(file.effects)
    return found


def _extended(
    values: Any, name: str, folder: Path = Path(), below: tuple[Path | None, ...] = ()
) -> dict[str, Any]:
    """Return the content of a scenario, merged with its base."""
    if not isinstance(values, dict):
        raise InputError(
            f"scenario '{name}': {shown(values)} is not a scenario; accepted: keys and values"
        )
    if "model" in values:
        raise InputError(
            f"scenario '{name}': model: accepted: tombo fly --model FILE in its place"
        )
    own = dict(values)
    base = own.pop("extends", None)
    parent = {} if base is None else _read(str(base), folder, below)[0]
    return merge_scenario(parent, own)


def load_scenario(
    name: str = DEFAULT_SCENARIO,
    settings: Sequence[str] = (),
    model: str | None = None,
    vehicle: str | VehicleFile | None = None,
) -> Scenario:
    """Read a built-in scenario by name, or a file by path, apply settings, and check it.

    Args:
        name: built-in name or path of a YAML file.
        settings: overrides such as "vehicle.mass=1.4" or "effects.steady_wind.east=2".
        model: path of a `model.yaml`, whose effects update those of the scenario; settings
            win over both.
        vehicle: a vehicle file, or its name or path, in place of the scenario's vehicle, propeller
            and gains; settings win over it.

    Raises:
        InputError: unknown scenario or key, wrong type, NaN, a value out of bounds, no model.
    """
    if not settings and model is None and vehicle is None and builtin_file(SCENARIOS, name):
        return _builtin(name)
    values, label = scenario_values(name, model, vehicle)
    return with_settings(values, settings, label)


@cache
def _builtin(name: str) -> Scenario:
    """Return a built-in scenario as it stands, read once: no file of the user's is in it."""
    values, label = scenario_values(name)
    return with_settings(values, (), label)


def scenario_values(
    name: str, model: str | None = None, vehicle: str | VehicleFile | None = None
) -> tuple[dict[str, Any], str]:
    """Return the plain values of a scenario before settings, and its name; as `load_scenario`.

    Raises:
        InputError: as `load_scenario`.
    """
    values, label = _read(name)
    if vehicle is not None:
        values["vehicle"] = vehicle
    values = _with_vehicle(values)
    if model is not None:
        extended = read_model(Path(model))
        own = "" if vehicle is None else vehicle_named(vehicle).name
        if extended.origin.vehicle not in ("", own):
            raise InputError(
                f"model '{model}' is of another vehicle ({extended.origin.vehicle}), its forces "
                f"are not those of {own or 'the suite'}; accepted: a model of the vehicle that is "
                "flown (--vehicle)"
            )
        plain = scenario_from_mapping(values, label)
        values |= {"effects": merge_effects(plain.effects, extended), "model": model}
    return values, label


def with_settings(values: dict[str, Any], settings: Sequence[str], label: str) -> Scenario:
    """Apply settings one after the other, and check the whole."""
    for setting in settings:
        values = _with_vehicle(merge_scenario(values, nested(setting)))
    scenario = scenario_from_mapping(values, label)
    if scenario.propeller.plain:
        for setting in settings:
            if setting.strip().startswith(_TOMBO_KEYS) and scenario.propeller.on_impact != "folds":
                raise InputError(
                    f"{setting.strip()}: the vehicle has a plain propeller (propeller.k_thrust or "
                    "curve); accepted: with a vehicle that has Tombo propellers"
                )
    return scenario


def scenario_over(
    base: Mapping[str, Any], label: str, name: str | None = None, settings: Sequence[str] = ()
) -> Scenario:
    """Build a scenario from a plain mapping, a scenario (name or path) over it, and settings.

    Raises:
        InputError: as `load_scenario`.
    """
    values = merge_scenario({}, base)
    if name is not None:
        over, _ = _read(name)
        values = merge_scenario(values, over)
    return with_settings(_with_vehicle(values), settings, label)


def extended_scenario(values: Mapping[str, Any], label: str) -> Scenario:
    """Build a scenario from a plain mapping, as in a file, with its base.

    Raises:
        InputError: as `load_scenario`.
    """
    return scenario_from_mapping(_extended(values, label), label)


def scenario_from_mapping(values: Mapping[str, Any], label: str) -> Scenario:
    """Build and check a scenario from a plain mapping.

    Raises:
        InputError: as `load_scenario`.
    """
    values = _with_vehicle(merge_scenario({}, values))
    accepted = [f.name for f in dataclasses.fields(Scenario)]
    built: dict[str, Any] = {"name": label}
    for key, value in values.items():
        if key not in accepted:
            raise unknown_name(f"key in scenario '{label}'", key, accepted)
        if key == "reaction":
            built[key] = reaction_from_mapping({} if value is None else value)
            if isinstance(built[key], Policy) and built[key].network is None:
                raise InputError(
                    "reaction.network: none; accepted: the JSON file of a policy, as in "
                    "--set reaction.network=policy.json (docs/gym.md)"
                )
        elif key in _SECTIONS:
            built[key] = from_mapping(_SECTIONS[key], value if value is not None else {}, key)
        elif key == "effects":
            if not isinstance(value, Mapping):
                raise InputError(f"effects: expected a mapping of effects, got {shown(value)}")
            for effect, parameters in value.items():
                if not isinstance(parameters, Mapping):
                    raise InputError(
                        f"effects.{effect}: expected a mapping of parameters, got "
                        f"{shown(parameters)}"
                    )
            built[key] = check_theta(value, "effects")
        elif key == "duration":
            built[key] = check_number("duration", value, "s", (0.1, 3600.0))
        elif key == "disturbances":
            built[key] = value
        else:
            built[key] = str(value)
    scenario = Scenario(**built)
    if scenario.propeller.law not in LAWS:
        raise unknown_name("propeller.law", scenario.propeller.law, LAWS)
    fitted = mounted_vehicle(scenario.vehicle, scenario.propeller)
    if scenario.detector.trigger not in TRIGGERS:
        raise unknown_name("detector.trigger", scenario.detector.trigger, TRIGGERS)
    check_volume(scenario.volume)
    check_course(scenario.mission, scenario.control, scenario.volume, fitted, scenario.propeller)
    return dataclasses.replace(scenario, vehicle=fitted)


def as_mapping(scenario: Scenario) -> dict[str, Any]:
    """Return the scenario as plain nested dictionaries, as in a file."""
    plain: dict[str, Any] = dataclasses.asdict(scenario)
    plain["reaction"]["name"] = scenario.reaction.name
    if not scenario.disturbances:
        del plain["disturbances"]
    left_out = dataclasses.asdict(PropellerChoice())
    plain["propeller"] = {
        key: value
        for key, value in plain["propeller"].items()
        if key in _ALWAYS_SAID or value != left_out[key]
    }
    unspread = dataclasses.asdict(SpreadParams())
    plain["spread"] = {k: v for k, v in plain["spread"].items() if v != 0.0 or unspread[k] != 0.0}
    for section in ("safety", "volume", "recovery", "contact"):
        record = getattr(scenario, section)
        defaults = dataclasses.asdict(type(record)())
        said = {key: value for key, value in plain.pop(section).items() if value != defaults[key]}
        plain |= {section: said} if said else {}
    course = plain["mission"]["course"]
    if isinstance(course, tuple):
        plain["mission"]["course"] = [
            {key: value for key, value in waypoint.items() if value is not None}
            for waypoint in course
        ]
    return plain


def world_of(scenario: Scenario) -> World:
    """Return the part of a scenario that is simulated, without autopilot and mission."""
    return World(
        scenario.vehicle,
        scenario.propeller,
        scenario.obstacle,
        scenario.spread,
        scenario.effects,
        scenario.estimator.mocap_rate,
    )


def override(
    values: dict[str, Any], setting: str, option: str = "--set", example: str = "vehicle.mass=1.4"
) -> dict[str, Any]:
    """Return nested values with one `key.path=value` setting applied.

    Raises:
        InputError: it is none; named by the `option` that it was given with, and an `example`.
    """
    return _merged(values, nested(setting, option, example))


def nested(
    setting: str, option: str = "--set", example: str = "vehicle.mass=1.4"
) -> dict[str, Any]:
    """Return a `key.path=value` setting as nested values; arguments and errors as `override`."""
    key, separator, text = setting.partition("=")
    if not separator or not key.strip():
        raise InputError(f"{option} '{setting}': expected key=value, as in {example}")
    *outer, last = key.strip().split(".")
    value: dict[str, Any] = {last: parse_yaml(text, f"{option} '{setting}': '{text}'")}
    for name in reversed(outer):
        value = {name: value}
    return value


def merge_scenario(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scenario's values merged with others, key by key; `over` has priority.

    Two keys set more than a value: `disturbances: true` adds the suite's values, which have
    priority over `base`; another `reaction.name` drops the parameters of the former reaction.

    Raises:
        InputError: `disturbances` is not true or false, or `base` has some that `over` does not
            want.
    """
    below, above = dict(base), dict(over)
    if above.pop("react", True) is False:  # recordings of older versions
        above["reaction"] = {"name": NoReaction.name}
    wanted = above.get("disturbances")
    if not isinstance(wanted, bool | None):
        raise InputError(f"disturbances: {shown(wanted)} is not true or false")
    if wanted and not below.get("disturbances"):
        below = _merged(below, disturbances())
    elif wanted is False and below.get("disturbances"):
        raise InputError(
            "disturbances: false over a scenario that has them; accepted: a scenario without"
        )
    chosen = _section(above, "reaction")
    if chosen.get("name", _reaction_name(below)) != _reaction_name(below):
        below.pop("reaction", None)
    return _merged(below, above)


def disturbances() -> dict[str, Any]:
    """Return what `disturbances: true` lays over a scenario."""
    path = SCENARIOS / "layers" / "disturbances.yaml"
    values: dict[str, Any] = parse_yaml(path.read_text(encoding="utf-8"), "disturbances.yaml")
    return values


def _section(values: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    section = values.get(key)
    return section if isinstance(section, Mapping) else {}


def _reaction_name(values: Mapping[str, Any]) -> Any:
    """Return the name of the reaction that some values choose."""
    return _section(values, "reaction").get("name", DEFAULT)


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(result.get(key), Mapping):
            result[key] = _merged(result[key], value)
        else:
            result[key] = value
    return result
