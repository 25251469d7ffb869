"""Effects by name: a simulation can switch them on, a diagnosis can fit them.

An effect is one decorated function. Its trailing arguments are its parameters; with all of them at
their null value it adds exactly nothing. Flights and thrust stands have a `Registry` each.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, TypeVar

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number

HEALTHY_SPREAD = 0.05
"""Standard deviation between healthy vehicles, as a share of a size that clearly matters: as after
careful weighing, balancing and calibration."""
_Function = TypeVar("_Function", bound=Callable[..., None])


@dataclass(frozen=True)
class Param:
    """One parameter of an effect."""

    name: str
    unit: str
    null: float
    bounds: tuple[float, float]
    doc: str
    typical: float
    """A size that clearly matters, for examples, tests and benchmarks."""
    scales_with: str = ""
    """That size grows with the range of this channel of a stand: thrust, torque."""


@dataclass(frozen=True)
class Effect:
    """A registered effect."""

    name: str
    stage: Enum
    """When it acts."""
    theta: tuple[Param, ...]
    doc: str
    signature: str
    """How it shows in data, in one line."""
    function: Callable[..., None]
    module: str
    separates_from: Mapping[str, str] = field(default_factory=dict)
    """Effects that look alike, and the manoeuvre or measurement that tells them apart."""
    models: tuple[str, ...] = ()
    """Nominal models that it makes sense for; empty: all."""
    state: type[Any] | None = None
    """Class of the record that it remembers from tick to tick, see `tombo_dynamics.records`."""
    stochastic: bool = False
    """It has no mean: the number of samples says how well its parameters can be fitted."""
    contact: bool = False
    """It acts only where the obstacle is touched."""
    company: bool = False
    """It acts only where another vehicle flies."""
    vibration: bool = False
    """It shows at the rotors' speeds and above alone: no fit to motion that is slower shows it."""
    saturates: bool = False
    """Its slope at the null value predicts nothing: only a fit shows its share."""
    confounded_with: tuple[str, ...] = ()
    """Effects that are not named as causes together with it: each may cancel the other."""
    healthy_spread: float = HEALTHY_SPREAD
    """Standard deviation of its parameters between healthy vehicles, as a share of the size that
    clearly matters; 0: every healthy vehicle has exactly the nominal value."""

    def size(self, p: Param) -> float:
        """Return the change of a parameter that clearly matters, in its unit.

        One without a typical size of its own has the largest of its unit.
        """
        alike = [abs(other.typical - other.null) for other in self.theta if other.unit == p.unit]
        return abs(p.typical - p.null) or max(alike) or abs(p.typical) or 1.0

    def tolerance(self, p: Param) -> float:
        """Return the standard deviation of a parameter between healthy vehicles, in its unit."""
        return self.healthy_spread * self.size(p)

    def suits(self, model: str) -> bool:
        """Return whether the effect makes sense for a nominal model."""
        return not self.models or model in self.models


class Registry(dict[str, Effect]):
    """The effects of one kind of data, by name, in the order in which they act within a stage."""

    def __init__(
        self, what: str, leading: int, prepare: Callable[[Any], Any] = lambda function: function
    ) -> None:
        """Make an empty registry.

        Args:
            what: an effect of it is called, in messages.
            leading: arguments of an effect's function before its state and parameters.
            prepare: applied to each function: compiles it.
        """
        super().__init__()
        self._what = what
        self._leading = leading
        self._prepare = prepare

    def effect(
        self,
        name: str,
        stage: Enum,
        theta: Sequence[Param],
        signature: str,
        separates_from: Mapping[str, str] | None = None,
        *,
        confounded_with: Sequence[str] = (),
        **traits: Any,
    ) -> Callable[[_Function], _Function]:
        """Register the decorated function as an effect.

        Args:
            name: unique name, as in scenario files.
            stage: when it acts.
            theta: its parameters, in the order of the function's trailing arguments.
            signature: how it shows in data, in one line.
            separates_from: other effects that look alike, and what tells them apart.
            confounded_with: see `Effect`.
            traits: further fields of `Effect`: state, stochastic, contact, company, vibration,
                saturates, models, healthy_spread.

        Raises:
            ValueError: the name is taken, or the arguments and `theta` do not agree.
        """

        def register(function: _Function) -> _Function:
            expected = [p.name for p in theta]
            if traits.get("state"):
                expected = ["state", *expected]
            if name in self:
                raise ValueError(f"{self._what} '{name}' is registered twice")
            if list(inspect.signature(function).parameters)[self._leading :] != expected:
                raise ValueError(
                    f"{self._what} '{name}': arguments do not match its parameters {expected}"
                )
            prepared: _Function = self._prepare(function)
            self[name] = Effect(
                name, stage, tuple(theta), inspect.getdoc(function) or "", signature, prepared,
                function.__module__, dict(separates_from or {}),
                confounded_with=tuple(confounded_with), **traits,
            )  # fmt: skip
            return prepared

        return register

    def check_theta(
        self, values: Mapping[str, Mapping[str, Any]], where: str
    ) -> dict[str, dict[str, float]]:
        """Check effect parameters given by name (a scenario file, a fitted model).

        Raises:
            InputError: an unknown effect or parameter, no mapping, or a value out of bounds.
        """
        checked: dict[str, dict[str, float]] = {}
        for name, parameters in values.items():
            if name not in self:
                raise unknown_name(f"{self._what} in {where}", name, self)
            if not isinstance(parameters, Mapping):
                raise InputError(
                    f"{where}.{name}: {shown(parameters)}; accepted: a mapping of parameters"
                )
            declared = {p.name: p for p in self[name].theta}
            checked[name] = {}
            for key, value in parameters.items():
                if key not in declared:
                    of = f"parameter of {self._what} '{name}' in {where}"
                    raise unknown_name(of, key, declared)
                p = declared[key]
                checked[name][key] = check_number(f"{where}.{name}.{key}", value, p.unit, p.bounds)
        return checked
