"""The registry of what can be wrong in a thrust-stand run, for simulation and fit alike.

An effect is one decorated function `(m, *theta)` that changes a `Run` in place; with all of its
parameters at their null value it adds exactly nothing. Nothing here is compiled.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_number

_Function = TypeVar("_Function", bound=Callable[..., None])


class Stage(IntEnum):
    """When an effect acts; within a stage in the order of the registry."""

    SPEED = 0
    """Changes the true speed, given what the tachometer says."""
    PROPELLER = 1
    """Changes the parameter rows that the law is solved with, and the air's inflow."""
    LOAD = 2
    """Changes the true loads after the law is solved."""
    READING = 3
    """Changes what the instruments show."""


@dataclass(frozen=True)
class StandParam:
    """One parameter of a stand effect."""

    name: str
    unit: str
    null: float
    bounds: tuple[float, float]
    doc: str
    typical: float
    """A value that clearly matters, on a stand for the nine-inch propellers."""
    scales_with: str = ""
    """The size that matters grows with the range of this channel ("thrust", "torque")."""


@dataclass(frozen=True)
class StandEffect:
    """A registered effect."""

    name: str
    stage: Stage
    theta: tuple[StandParam, ...]
    doc: str
    signature: str
    separates_from: Mapping[str, str]
    """Effects that look alike, and the measurement that tells them apart."""
    models: tuple[str, ...]
    """Nominal models that it makes sense for: tombo, plain (T = k omega^2)."""
    stochastic: bool
    """True: it has no mean, only a width."""
    function: Callable[..., None]


STAND_EFFECTS: dict[str, StandEffect] = {}


def stand_effect(
    name: str,
    stage: Stage,
    theta: list[StandParam],
    signature: str,
    separates_from: Mapping[str, str] | None = None,
    models: tuple[str, ...] = ("tombo", "plain"),
    stochastic: bool = False,
) -> Callable[[_Function], _Function]:
    """Register the decorated function as an effect of a stand run.

    Args:
        name: unique name.
        stage: when it acts.
        theta: its parameters, in the order of the function's arguments after the run.
        signature: how it shows in data, in one line.
        separates_from: other effects that look alike, and what tells them apart.
        models: nominal models that it makes sense for.
        stochastic: whether it draws from chance and has no mean.

    Raises:
        ValueError: the name is taken, or the arguments and `theta` do not agree.
    """

    def register(function: _Function) -> _Function:
        names = [p.name for p in theta]
        if name in STAND_EFFECTS:
            raise ValueError(f"stand effect '{name}' is registered twice")
        if list(inspect.signature(function).parameters)[1:] != names:
            raise ValueError(f"stand effect '{name}': arguments do not match {names}")
        STAND_EFFECTS[name] = StandEffect(
            name,
            stage,
            tuple(theta),
            inspect.getdoc(function) or "",
            signature,
            dict(separates_from or {}),
            models,
            stochastic,
            function,
        )
        return function

    return register


def check_stand_theta(
    values: Mapping[str, Mapping[str, object]], where: str
) -> dict[str, dict[str, float]]:
    """Check parameters of stand effects given by name.

    Raises:
        InputError: an unknown effect or parameter, no mapping, or a value out of bounds.
    """
    checked: dict[str, dict[str, float]] = {}
    for name, given in values.items():
        if name not in STAND_EFFECTS:
            raise unknown_name(f"stand effect in {where}", name, STAND_EFFECTS)
        if not isinstance(given, Mapping):
            raise InputError(f"{where}.{name}: {given!r:.40}; accepted: a mapping of parameters")
        declared = {p.name: p for p in STAND_EFFECTS[name].theta}
        checked[name] = {}
        for key, value in given.items():
            if key not in declared:
                raise unknown_name(f"parameter of stand effect '{name}'", key, declared)
            p = declared[key]
            checked[name][key] = check_number(f"{where}.{name}.{key}", value, p.unit, p.bounds)
    return checked
