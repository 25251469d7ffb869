"""Values of a scenario laid over others: what a file extends, settings, disturbances."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

from tombo_collision.reactions import DEFAULT
from tombo_collision.reactions.none import NoReaction
from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.yaml_text import parse_yaml


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
    value = {last: parse_yaml(text, f"{option} '{setting}': '{text}'")}
    for name in reversed(outer):
        value = {name: value}
    return value


def laid_over(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scenario's values with others over them, key by key.

    Two keys stand for more than a value: with `disturbances: true` those of the suite lie between
    the two; another `reaction.name` leaves the parameters of the reaction before. `react`, a word
    of older files, chooses a reaction: false none, true the default one where there was none.

    Raises:
        InputError: `react` or `disturbances` is not true or false, or `base` has disturbances that
            `over` does not want.
    """
    below, above = dict(base), dict(over)
    if _flag(above, "react") is not None:
        above["reaction"] = _reaction_of(below, above, react=above.pop("react"))
    wanted = _flag(above, "disturbances")
    if wanted and not below.get("disturbances"):
        below = _merged(below, disturbances())
    elif wanted is False and below.get("disturbances"):
        raise InputError(
            "disturbances: false over a scenario that has them; accepted: a scenario without"
        )
    chosen = _section(above, "reaction")
    if chosen.get("name", _name(below)) != _name(below):
        below.pop("reaction", None)
    return _merged(below, above)


def disturbances() -> dict[str, Any]:
    """Return what `disturbances: true` lays over a scenario."""
    path = resources.files("tombo_flight").joinpath("scenarios", "layers", "disturbances.yaml")
    values: dict[str, Any] = parse_yaml(path.read_text(encoding="utf-8"), "disturbances.yaml")
    return values


def _flag(values: Mapping[str, Any], key: str) -> bool | None:
    """Return a key that is true or false; None: it is not there."""
    value = values.get(key)
    if key in values and not isinstance(value, bool):
        raise InputError(f"{key}: {shown(value)} is not true or false")
    return value


def _section(values: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    section = values.get(key)
    return section if isinstance(section, Mapping) else {}


def _name(values: Mapping[str, Any]) -> Any:
    """Return the name of the reaction that some values choose."""
    return _section(values, "reaction").get("name", DEFAULT)


def _reaction_of(
    below: Mapping[str, Any], above: Mapping[str, Any], *, react: bool
) -> dict[str, Any]:
    """Return the reaction that `react` means, over `below` and beside what `above` has."""
    own = dict(_section(above, "reaction"))
    if not react:
        return {"name": NoReaction.name}
    return {"name": DEFAULT, **own} if _name(below) == NoReaction.name else own


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(result.get(key), Mapping):
            result[key] = _merged(result[key], value)
        else:
            result[key] = value
    return result
