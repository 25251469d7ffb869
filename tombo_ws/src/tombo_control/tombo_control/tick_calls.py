"""The parts of an autopilot's tick for whoever runs them one by one from Python, at each tick.

Autopilot and rotor table are handed over as arrays (1), see `Record.as_array`.
"""

from __future__ import annotations

from typing import Any

from tombo_control import estimator
from tombo_control.loops import cascade
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled

_store_history, _predict = estimator.store_history, estimator.predict
_update_body_rates = estimator.update_body_rates
_run_control_loops, _cascade = cascade.run_control_loops, cascade.cascade


@compiled(inline=False)
def store_history(autopilots: Any, tick: int) -> None:
    """Store the present estimate in the history, as the state at `tick`."""
    _store_history(autopilots[0].state, autopilots[0].history, tick)


@compiled(inline=False)
def update_body_rates(autopilots: Any, gyro: Array) -> None:
    """Set the body rates to the gyro (3) minus its bias [rad/s]."""
    _update_body_rates(autopilots[0].state, gyro)


@compiled(inline=False)
def predict(autopilots: Any, accel: Array, airborne: bool) -> None:
    """Carry the estimate over one tick with the specific force (3) [m/s^2]."""
    _predict(autopilots[0].state, accel, airborne)


@compiled(inline=False)
def run_control_loops(
    autopilots: Any, maps: Any, position: bool, attitude: bool, blind: bool
) -> None:
    """Run the rate loop, and the position and the attitude loop if they are due."""
    _run_control_loops(autopilots[0], maps[0], position, attitude, blind)


@compiled(inline=False)
def run_cascade(autopilots: Any, maps: Any, tick: int) -> None:
    """Run the loops that are due in `tick`."""
    _cascade(autopilots[0], maps[0], tick)
