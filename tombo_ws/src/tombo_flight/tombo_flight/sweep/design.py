"""The points of a sweep: which settings are varied, over which values, and in which design."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name

DESIGNS = ("full", "lhs", "sobol")
"""Full factorial, Latin hypercube, Sobol sequence (scrambled)."""
MOST_LEVELS = 10_000
MOST_SAMPLES = 10_000_000
_DRAW_SEED = 0
"""Seed of Latin hypercube and Sobol: the same command has the same points."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"({_NUMBER}):({_NUMBER})(?::({_NUMBER}))?")
_DISTRIBUTION = re.compile(rf"([a-z_]\w*)\(\s*({_NUMBER}(?:\s*,\s*{_NUMBER})*)\s*\)")
_ACCEPTED = (
    "accepted: KEY=A:B:STEP or KEY=V1,V2,..., as in vehicle.mass=1.1:1.7:0.1; with --design lhs "
    "or sobol also KEY=A:B and KEY=norm(1.3,0.02), a distribution of scipy.stats"
)


@dataclass(frozen=True)
class Axis:
    """A setting that is varied: over levels, between two numbers, or with a distribution."""

    key: str
    """Key as of --set: "vehicle.mass"."""
    levels: tuple[str, ...] = ()
    """Values as texts of --set."""
    low: float = 0.0
    high: float = 0.0
    """Ends of a range without levels."""
    distribution: str = ""
    """Distribution of scipy.stats, with its arguments: "norm(1.3,0.02)"."""

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers."""
        return all(re.fullmatch(_NUMBER, level) for level in self.levels)

    @cached_property
    def frozen(self) -> Any:
        """The distribution of scipy.stats with its arguments.

        Raises:
            InputError: there is none of this name, or it does not accept these arguments.
        """
        from scipy import stats

        name, numbers = _DISTRIBUTION.fullmatch(self.distribution).groups()  # type: ignore[union-attr]
        kind = getattr(stats, name, None)
        accepted = "norm(mean,deviation), uniform(low,width), or another of scipy.stats"
        if isinstance(kind, stats.rv_continuous):
            with suppress(TypeError):  # another number of arguments
                frozen = kind(*(float(number) for number in numbers.split(",")))
                if math.isfinite(frozen.ppf(0.5)):
                    return frozen
        raise InputError(
            f"'{self.key}={self.distribution}': no continuous distribution; accepted: {accepted}"
        )

    def value_at(self, share: float) -> str:
        """Return the value at a share (0 to 1) of the axis, of a distribution its quantile."""
        if self.levels:
            return self.levels[min(int(share * len(self.levels)), len(self.levels) - 1)]
        if self.distribution:
            return number_text(float(self.frozen.ppf(share)))
        return number_text(self.low + share * (self.high - self.low))


@dataclass(frozen=True)
class SweepDesign:
    """The points of a sweep."""

    axes: tuple[Axis, ...] = ()
    kind: str = "full"
    """One of `DESIGNS`."""
    samples: int = 0
    """Points of a Latin hypercube or a Sobol sequence."""

    def __post_init__(self) -> None:
        """Refuse a design that has no points.

        Raises:
            InputError: unknown kind; a repeated key or value; a range or a distribution in a full
            design; an unknown distribution; or no samples of a drawn one.
        """
        if self.kind not in DESIGNS:
            raise unknown_name("--design", self.kind, DESIGNS)
        keys = [axis.key for axis in self.axes]
        if len(set(keys)) < len(keys):
            raise InputError(f"{', '.join(keys)}: varied twice; accepted: each key once")
        for axis in self.axes:
            if len(set(axis.levels)) < len(axis.levels):
                raise InputError(f"{axis.key}: a value is given twice; accepted: each once")
            if axis.distribution:
                _ = axis.frozen
        if self.kind == "full":
            for axis in self.axes:
                if not axis.levels:
                    given = axis.distribution or f"{axis.low:g}:{axis.high:g}"
                    raise InputError(f"{axis.key}={given}: no levels; {_ACCEPTED}")
        elif not self.axes or not 1 <= self.samples <= MOST_SAMPLES:
            raise InputError(
                f"--design {self.kind}: {self.samples} samples of {len(keys)} keys; accepted: "
                f"--samples N, 1 to {MOST_SAMPLES}, and at least one KEY=A:B"
            )

    @property
    def points(self) -> int:
        """Number of points."""
        return self.samples or math.prod(len(axis.levels) for axis in self.axes)

    @cached_property
    def _drawn(self) -> Array:
        """Shares from 0 to 1, (samples, axes)."""
        from scipy.stats import qmc

        if self.kind == "lhs":
            drawn = qmc.LatinHypercube(len(self.axes), seed=_DRAW_SEED).random(self.samples)
        else:
            power = math.ceil(math.log2(self.samples)) if self.samples > 1 else 0
            sobol = qmc.Sobol(len(self.axes), seed=_DRAW_SEED)
            drawn = sobol.random_base2(power)[: self.samples]
        return np.asarray(drawn)

    def settings(self, point: int) -> dict[str, str]:
        """Return key → text of --set of a point, from 0; the last one varies fastest."""
        if self.samples:
            shares = self._drawn[point].tolist()
            return {a.key: a.value_at(u) for a, u in zip(self.axes, shares, strict=True)}
        levels = np.unravel_index(point, [len(axis.levels) for axis in self.axes])
        return {a.key: a.levels[int(n)] for a, n in zip(self.axes, levels, strict=True)}

    def values_to_check(self, axis: Axis) -> tuple[str, ...]:
        """Return the values of an axis that must be accepted: its levels, or both ends."""
        if axis.levels:
            return axis.levels
        drawn = self._drawn[:, self.axes.index(axis)]
        return axis.value_at(float(drawn.min())), axis.value_at(float(drawn.max()))


def parse_axis(text: str) -> Axis:
    """Return the axis that a text such as `KEY=A:B:STEP` means, see `axis_of`.

    Raises:
        InputError: of none of the forms.
    """
    key, sign, values = text.partition("=")
    if not sign or not key.strip() or not values.strip():
        raise InputError(f"'{text}': {_ACCEPTED}")
    return axis_of(key.strip(), values.strip())


def axis_of(key: str, values: str | Sequence[Any]) -> Axis:
    """Return the axis of a key: from the text behind KEY=, or from its values.

    Args:
        key: as of --set.
        values: A:B:STEP or A:B with both ends, V1,V2,…, a distribution, or a list of values.

    Raises:
        InputError: there are none, or too many.
    """
    if not isinstance(values, str):
        levels = tuple(value_text(value) for value in values)
        if not levels:
            raise InputError(f"{key}: no values; accepted: at least one")
        return Axis(key, levels)
    text = f"{key}={values}"
    if _DISTRIBUTION.fullmatch(values):
        return Axis(key, distribution=re.sub(r"\s", "", values))
    limits = _RANGE.fullmatch(values)
    if limits is None:
        parts = tuple(part.strip() for part in values.split(","))
        if not all(parts):
            raise InputError(f"'{text}': an empty value; {_ACCEPTED}")
        return Axis(key, parts)
    low, high = float(limits[1]), float(limits[2])
    if low > high:
        raise InputError(f"'{text}': {low:g} is above {high:g}; {_ACCEPTED}")
    if limits[3] is None:
        return Axis(key, low=low, high=high)
    step = float(limits[3])
    if not step > 0.0 or (high - low) / step >= MOST_LEVELS:
        raise InputError(
            f"'{text}': STEP {step:g}; accepted: above 0, {MOST_LEVELS} values at most"
        )
    count = math.floor((high - low) / step + 1e-9) + 1
    return Axis(key, tuple(number_text(round(low + i * step, 12)) for i in range(count)))


def number_text(value: float) -> str:
    """Return a number as --set reads it back to the last digit."""
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def value_text(value: Any) -> str:
    """Return a plain value as --set reads it."""
    if isinstance(value, str):
        return value
    return json.dumps(value.tolist() if hasattr(value, "tolist") else value)
