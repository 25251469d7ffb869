"""`stand_model.yaml`: the effects that a stand diagnosis adds to the propeller model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tombo_diagnosis.diagnosis import Cause, Diagnosis
from tombo_diagnosis.extend_model import EXTENDING_VERDICTS
from tombo_diagnosis.wording import display_name
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.effects import STAND_EFFECTS, check_stand_theta
from tombo_dynamics.yaml_text import read_yaml
from tombo_flight.extended_model import FittedParameter, Gain
from tombo_flight.json_text import plain


def differences_from_model(causes: Sequence[Cause]) -> list[str]:
    """Return, of each cause that the model has a value of, how these runs depart from it."""
    return [_difference_text(c, f) for c in causes for f in _known_to_model(c)[:1]]


def model_extending_causes(causes: Sequence[Cause]) -> list[Cause]:
    """Return the causes that extend a model: not stochastic, and not just absent in these runs."""
    return [c for c in causes if not STAND_EFFECTS[c.effect].stochastic and not _absent(c)]


def _known_to_model(cause: Cause) -> list[FittedParameter]:
    """Return the parameters of which the model has a value of its own."""
    effect = STAND_EFFECTS[cause.effect]
    if effect.stochastic:
        return []
    nulls = {p.name: p.null for p in effect.theta}
    return [f for f in cause.theta if f.nominal != nulls[f.name]]


def _absent(cause: Cause) -> bool:
    """Return whether the model has it and these runs have not."""
    nulls = {p.name: p.null for p in STAND_EFFECTS[cause.effect].theta}
    parameters = _known_to_model(cause)
    return bool(parameters) and all(f.low <= nulls[f.name] <= f.high for f in cause.theta)


def _difference_text(cause: Cause, f: FittedParameter) -> str:
    name, unit = display_name(cause.effect), "" if f.unit == "1" else f" {f.unit}"
    here = f"{f.value:.2g} ± {0.5 * (f.high - f.low):.1g}{unit}"
    if _absent(cause):
        return f"the model’s {name} {f.nominal:.3g}{unit} is not in these runs ({here})"
    return f"{name} is {here} in these runs, {f.nominal:.3g}{unit} in the model"


FORMAT = 1
_HEAD = (
    "# What thrust-stand data add to the propeller model.\n"
    "# Hold other data against it: tombo propeller diagnose OTHER.csv --model THIS_FILE\n"
)


@dataclass(frozen=True)
class StandModel:
    """The effects that a `stand_model.yaml` adds to the propeller model."""

    theta: Mapping[str, tuple[float, ...]]
    """Effect -> its parameters."""
    written: Mapping[str, Any]
    """Effect -> what the file says of it, intervals included."""


def extends_model(diagnosis: Diagnosis) -> bool:
    """Return whether something was found that a model can take over."""
    return diagnosis.verdict in EXTENDING_VERDICTS and bool(
        model_extending_causes(diagnosis.causes)
    )


def stand_model_text(
    diagnosis: Diagnosis, tool: str, date: str, given: StandModel | None = None
) -> str:
    """Return the text of `stand_model.yaml`.

    `given` is the model that the runs were compared with. Its effects stay; an effect
    that was found again gets the new parameters.
    """
    new = {cause.effect for cause in diagnosis.causes}
    unchanged = {} if given is None else {e: c for e, c in given.written.items() if e not in new}
    values = {
        "tombo_stand_model": FORMAT,
        "effects": unchanged | {
            cause.effect: {
                "confidence": cause.confidence,
                "parameters": {
                    f.name: _fields(f, "value", "unit", "nominal", "low", "high")
                    for f in cause.theta
                },
                "covariance": cause.covariance,
            }
            for cause in model_extending_causes(diagnosis.causes)
        },
        "origin": {
            "model": diagnosis.model,
            "verdict": diagnosis.verdict,
            "tool": tool,
            "date": date,
            "runs": [note.source for note in diagnosis.flights],
        },
        "gain": [
            _fields(g, "channel", "unit", "before", "after", "low", "high") for g in diagnosis.gain
        ],
        "notes": diagnosis.notes,
    }  # fmt: skip
    text: str = yaml.safe_dump(plain(values), sort_keys=False, allow_unicode=True, width=99)
    return f"{_HEAD}{text}"


def _fields(record: FittedParameter | Gain, *names: str) -> dict[str, Any]:
    return {name: getattr(record, name) for name in names}


def read_stand_model(path: Path) -> StandModel:
    """Return the effects that a file adds to the model.

    Raises:
        InputError: it can't be read, is no such model, or holds unknown effects or values out of
            bounds.
    """
    what = f"stand model '{path}'"
    values = read_yaml(path, what, "a stand_model.yaml")
    if not isinstance(values, Mapping) or values.get("tombo_stand_model") != FORMAT:
        raise InputError(f"{what} is none; accepted: a stand_model.yaml of propeller diagnose")
    effects = values.get("effects")
    if not isinstance(effects, Mapping) or not effects:
        raise InputError(f"{what}: effects: none; accepted: at least one")
    parameters_of: dict[str, dict[str, Any]] = {}
    for name, content in effects.items():
        parameters = content.get("parameters") if isinstance(content, Mapping) else None
        if not isinstance(parameters, Mapping):
            raise InputError(f"{what}: {name}: no parameters; accepted: a mapping of them")
        parameters_of[str(name)] = {
            str(k): v.get("value") if isinstance(v, Mapping) else v for k, v in parameters.items()
        }
    checked = check_stand_theta(parameters_of, what)
    theta = {
        name: tuple(values_of_effect.get(p.name, p.null) for p in STAND_EFFECTS[name].theta)
        for name, values_of_effect in checked.items()
    }
    return StandModel(theta, {str(name): content for name, content in effects.items()})
