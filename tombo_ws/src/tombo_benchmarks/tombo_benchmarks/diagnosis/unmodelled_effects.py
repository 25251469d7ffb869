"""Causes that no candidate describes: the diagnosis must not give them anybody's name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import Setup

_Shape = Callable[[Array, Setup, float, np.random.Generator], Array]


def _share(setup: Setup) -> Array:
    return setup.speed / max(float(setup.speed.max()), 1e-9)


def _times(y: Array, thrust: Array, torque: Array | float = 1.0) -> Array:
    """Return readings (N, 4), thrust and torque by these factors (N,)."""
    out = y.copy()
    out[:, 0] *= thrust
    out[:, 1] *= torque
    return out


def _blade_stall(y: Array, setup: Setup, size: float, rng: np.random.Generator) -> Array:
    """Thrust stops growing as it did beyond a speed, torque grows more."""
    over = np.maximum(_share(setup) - rng.uniform(0.55, 0.75), 0.0)
    return _times(y, 1.0 - size * 0.6 * over, 1.0 + size * 0.9 * over)


def _hub_friction(y: Array, setup: Setup, size: float, rng: np.random.Generator) -> Array:
    """A bearing takes torque that grows with the speed itself; dry friction below it."""
    out = y.copy()
    x = _share(setup)
    out[:, 1] += size * 0.03 * setup.largest_torque * np.tanh(12.0 * x) * (0.4 + x)
    out[:, 0] += size * 0.02 * setup.largest_thrust * np.sin(5.0 * x)  # the hub tilts under it
    return out


def _stand_ground_effect(y: Array, setup: Setup, size: float, rng: np.random.Generator) -> Array:
    """The bench below pushes back, the more the slower the wake."""
    gain = size * 0.12 * np.exp(-((_share(setup) / rng.uniform(0.3, 0.5)) ** 2))
    return _times(y, 1.0 + gain)


def _reynolds(y: Array, setup: Setup, size: float, rng: np.random.Generator) -> Array:
    """Lift and drag coefficients change with a power of the speed."""
    x = np.maximum(_share(setup), 0.05)
    return _times(y, x ** (size * 0.08), x ** (-size * 0.12))


def _resonance(y: Array, setup: Setup, size: float, rng: np.random.Generator) -> Array:
    """The stand's arm resonates at one speed and the cell reads wrong there."""
    at, width = rng.uniform(0.35, 0.75), 0.08
    bump = np.exp(-(((_share(setup) - at) / width) ** 2))
    return _times(y, 1.0 - size * 0.08 * bump, 1.0 + size * 0.06 * bump)


def _creep(y: Array, setup: Setup, size: float, rng: np.random.Generator) -> Array:
    """The silicone creeps: way down differs from way up by a share that peaks in the middle."""
    e = setup.elapsed
    thrust = 1.0 - size * 0.06 * np.sin(np.pi * e) * (e > 0.5)
    return _times(y, thrust, 1.0 + size * 0.03 * np.sin(2.0 * np.pi * e))


def _cell_saturation(y: Array, setup: Setup, size: float, rng: np.random.Generator) -> Array:
    """The cell's reading bends near the end of its range."""
    top = setup.largest_thrust
    out = y.copy()
    out[:, 0] -= size * 0.12 * top * np.maximum(np.abs(y[:, 0]) / top - 0.5, 0.0) ** 2 * 4.0
    return out


UNMODELLED_EFFECTS: Mapping[str, _Shape] = {
    "blade_stall": _blade_stall,
    "hub_friction": _hub_friction,
    "stand_ground_effect": _stand_ground_effect,
    "reynolds_number": _reynolds,
    "stand_resonance": _resonance,
    "creep": _creep,
    "cell_saturation": _cell_saturation,
}
"""Name -> function of the readings (N, 4), the points, a size of about one, and chance."""
