"""The registry: every effect that a simulation can switch on and a diagnosis can fit.

An effect is one decorated function. Its keyword-like trailing arguments are its parameters; with
all of them at their null value the effect adds exactly nothing. The decorator compiles the
function and enters it; simulation, scenario files, documentation and generic tests pick it up from
here.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeVar

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.jit import compiled
from tombo_dynamics.params import check_number

_Function = TypeVar("_Function", bound=Callable[..., None])


class Stage(Enum):
    """When in a tick an effect acts, and what it may change in the plant's memory."""

    BODY = "body"
    """Once, before the flight: `inertial`, `draws`."""
    AIR = "air"
    """Each tick: adds to `wind`."""
    ROTOR = "rotor"
    """Each tick: multiplies `efficiency`, moves `fold` and `damage`, adds to `strike`."""
    COMMAND = "command"
    """Each tick: changes `target`, the rotor speeds that the drives work towards."""
    WRENCH = "wrench"
    """Each evaluation of the dynamics: adds to `wrench` (body frame, at the centre of mass)."""
    IMU = "imu"
    """Each tick: changes `imu`."""
    MOCAP = "mocap"
    """Each motion-capture sample: changes `mocap` (pose, latency, dropped, error of the stamp)."""


@dataclass(frozen=True)
class Param:
    """One parameter of an effect."""

    name: str
    unit: str
    null: float
    bounds: tuple[float, float]
    doc: str
    typical: float
    """A size that clearly matters in flight, for examples, tests and benchmarks."""


@dataclass(frozen=True)
class Effect:
    """A registered effect."""

    name: str
    stage: Stage
    theta: tuple[Param, ...]
    doc: str
    signature: str
    separates_from: Mapping[str, str]
    function: Callable[..., None]
    module: str


REGISTRY: dict[str, Effect] = {}


def effect(
    name: str,
    stage: Stage,
    theta: list[Param],
    signature: str,
    separates_from: Mapping[str, str] | None = None,
) -> Callable[[_Function], _Function]:
    """Register the decorated function as an effect.

    The function takes `(m, noise, *theta)`: the vehicle's memory (see `tombo_dynamics.plant`), the
    standard normal numbers of the tick (or of the mocap sample), and the parameters in order.

    Args:
        name: unique name, as in scenario files.
        stage: when it acts.
        theta: its parameters, in the order of the function's trailing arguments.
        signature: how it shows in data, in one line.
        separates_from: other effects that look alike, and the manoeuvre that tells them apart.

    Raises:
        ValueError: the name is taken, or the arguments and `theta` do not agree.
    """

    def register(function: _Function) -> _Function:
        names = [p.name for p in theta]
        if name in REGISTRY:
            raise ValueError(f"effect '{name}' is registered twice")
        if list(inspect.signature(function).parameters)[2:] != names:
            raise ValueError(f"effect '{name}': arguments do not match its parameters {names}")
        fast = compiled(function)
        REGISTRY[name] = Effect(
            name,
            stage,
            tuple(theta),
            inspect.getdoc(function) or "",
            signature,
            dict(separates_from or {}),
            fast,
            function.__module__,
        )
        return fast

    return register


def check_theta(
    values: Mapping[str, Mapping[str, Any]], where: str
) -> dict[str, dict[str, float]]:
    """Check effect parameters given by name (a scenario file, a fitted model).

    Raises:
        InputError: an unknown effect or parameter, no mapping, or a value out of bounds.
    """
    checked: dict[str, dict[str, float]] = {}
    for name, given in values.items():
        if name not in REGISTRY:
            raise unknown_name(f"effect in {where}", name, REGISTRY)
        if not isinstance(given, Mapping):
            raise InputError(f"{where}.{name}: expected a mapping of parameters, got {given!r}")
        declared = {p.name: p for p in REGISTRY[name].theta}
        checked[name] = {}
        for key, value in given.items():
            if key not in declared:
                raise unknown_name(f"parameter of effect '{name}' in {where}", key, declared)
            p = declared[key]
            checked[name][key] = check_number(f"{where}.{name}.{key}", value, p.unit, p.bounds)
    return checked
