"""Many operating points in one compiled call."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.propeller.laws.equilibrium import equilibrium
from tombo_dynamics.propeller.laws.names import LAWS, OK
from tombo_dynamics.propeller.laws.parameters import Parameters, unpack
from tombo_dynamics.propeller.laws.published import published_point
from tombo_dynamics.propeller.laws.wing_loads import twisted

Whole = NDArray[np.int64]

COLUMNS = 8
"""Columns of a solution: thrust [N], drag [N], torque [N m], alpha, beta, gamma [rad], L/D,
verdict (OK, TWIST_OUT_OF_RANGE or NO_EQUILIBRIUM)."""
_PUBLISHED = LAWS["published"]
_OK = OK


@compiled
def solve_point(law: int, p: Parameters, speed: float, out: Array) -> None:
    """Write the operating point at `speed` [rad/s] into `out` (COLUMNS,)."""
    square = speed * speed
    rigid = p.flap_compliance == 0.0 and p.lag_compliance == 0.0 and p.twist_compliance == 0.0
    if law == _PUBLISHED and not rigid:
        alpha, beta, gamma, thrust, drag, torque, verdict = published_point(p, square)
    else:
        alpha, beta, gamma, verdict = 0.0, 0.0, 0.0, _OK
        if not rigid:
            alpha, beta, gamma, verdict = equilibrium(law, p, square)
        c = math.cos(alpha) * math.cos(beta)
        s, k = math.sin(gamma), math.cos(gamma)
        thrust = p.inner_thrust + c * twisted(p.lift, p.lift_rate, gamma, s, k)[0]
        drag = p.inner_drag + c * twisted(p.drag, p.drag_rate, gamma, s, k)[0]
        torque = p.inner_torque + c * twisted(p.torque, p.drag_rate, gamma, s, k)[0]
    q = p.air_density * square
    out[0] = q * thrust
    out[1] = q * drag
    out[2] = q * torque
    out[3] = alpha
    out[4] = beta
    out[5] = gamma
    out[6] = thrust / drag
    out[7] = verdict


@compiled
def solve_points(law: int, rows: Array, which: Whole, speeds: Array, out: Array) -> None:
    """Solve point by point.

    Args:
        law: number of the law (`laws.names.LAWS`).
        rows: (r, ROW_SIZE), one a propeller.
        which: (n,) the propeller of each point, 0 to r - 1.
        speeds: (n,) rotor speeds [rad/s], finite and not negative.
        out: (n, COLUMNS) is written.
    """
    for i in range(speeds.shape[0]):
        solve_point(law, unpack(rows[which[i]]), speeds[i], out[i])
