"""A grid of operating points: every configuration with every change at every speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.evaluate import Operation, evaluate
from tombo_dynamics.propeller.laws.parameters import DEFAULT_LAW
from tombo_dynamics.propeller.parameter_rows import MATERIALS, family
from tombo_dynamics.propeller.records import STANDARD, Surroundings


@dataclass(frozen=True, eq=False, repr=False)
class OperationGrid(Operation):
    """Operating points on a grid: the arrays' dimensions are `axes`, in their order."""

    axes: Mapping[str, NDArray[np.generic]]
    """What was varied, by name: (n,) each; configurations first, speeds last."""

    def table(self, **columns: ArrayLike) -> dict[str, NDArray[np.generic]]:
        """Return the points as columns (n,), those of the axes first; see `Operation.table`."""
        varied = [name for name in self.axes if name != "speed_rad_s"]
        grid = np.meshgrid(*self.axes.values(), indexing="ij")
        axes: dict[str, Any] = dict(zip(varied, grid, strict=False))
        return super().table(**axes, **columns)


def sweep(
    configurations: Any,
    speed_rad_s: ArrayLike,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
    outside: str = "mask",
    **changes: Any,
) -> OperationGrid:
    """Return the operating points of every configuration with every change at every speed.

    `sweep([5, 13], speeds, length_mm=[8, 12, 16]).thrust_N` has the shape (2, 3, n).

    Args:
        configurations: a Configuration, a number of Table I, or a list of them.
        speed_rad_s: rotor speeds [rad/s], one or a list.
        law: "published", "repaired" or "consistent".
        surroundings: air density and gravity.
        outside: "mask" (NaN where the law is not valid), "keep" or "error", see `evaluate`.
        **changes: quantities by name, each a number or a list, see `parameter_rows`.

    A list is an axis of the grid, a single value is none.

    Raises:
        InputError: what is not accepted, see `evaluate`; a list of lists.
    """
    chosen = family(configurations)
    arguments: dict[str, NDArray[Any]] = {"configuration": chosen.index}
    for name, value in changes.items():
        arguments[name] = np.array(value, dtype=object if name in MATERIALS else None)
    arguments["speed_rad_s"] = np.asarray(speed_rad_s)
    for name, values in arguments.items():
        if values.ndim > 1:
            raise InputError(
                f"{name} of shape {values.shape}; accepted: one value or a list, each list is an "
                "axis of the grid; evaluate takes any shapes that broadcast"
            )
        if not values.size:
            raise InputError(f"{name} is empty; accepted: one or more values")
    varied = [name for name, values in arguments.items() if values.ndim]
    for i, name in enumerate(varied):
        arguments[name] = arguments[name].reshape((-1,) + (1,) * (len(varied) - 1 - i))
    members = np.empty(len(chosen.members), dtype=object)
    members[:] = chosen.members
    labels = [m.name or m.number for m in chosen.members]
    points = evaluate(
        members[arguments.pop("configuration")],
        arguments.pop("speed_rad_s"),
        law,
        surroundings,
        outside,
        **arguments,
    )
    named = {"configuration": np.asarray(labels)[chosen.index], "speed_rad_s": speed_rad_s}
    axes = {name: _axis(named.get(name, changes.get(name))) for name in varied}
    columns = {f.name: getattr(points, f.name) for f in dataclasses.fields(Operation)}
    return OperationGrid(**columns, axes=axes)


def _axis(values: Any) -> NDArray[Any]:
    """Return what stands along an axis, materials by their names."""
    return np.array([getattr(value, "name", value) for value in np.atleast_1d(values)])
