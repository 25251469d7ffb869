"""Predicted readings of a stand: the law and all effects, one function for simulation and fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects.registry import CHANNELS, STAND_EFFECTS, StandRun, StandStage
from tombo_dynamics.propeller.effects.rotor import turn_inflow
from tombo_dynamics.propeller.evaluate import SPEED_LIMIT, evaluate_rows
from tombo_dynamics.propeller.laws.parameters import DEFAULT_LAW, SCALARS

_INFLOW_RADIUS = 0.7
"""Of the tip radius: where the inflow's angle is taken."""
_OTHER_LAW = {"repaired": "consistent", "published": "consistent", "consistent": "repaired"}


@dataclass(frozen=True)
class Setup:
    """Operating points that are imposed on the stand; arrays are (N,)."""

    speed: Array
    """As the tachometer shows it [rad/s]; 0 with a known load."""
    rows: Array
    """(N, ROW_SIZE) from `parameter_row` of each point's law; (N, 2) of k_T and k_Q if plain."""
    propeller: NDArray[np.int64]
    """Number of the propeller at each point, from 0."""
    run: NDArray[np.int64]
    """Number of the run, from 0."""
    elapsed: Array
    """Share of the run that has passed."""
    law: str = DEFAULT_LAW
    plain: bool = False
    tip_radius_m: float = 0.1111
    applied_thrust: Array = field(default_factory=lambda: np.zeros(0))
    """Known loads on the thrust cell [N]; empty: none."""
    applied_torque: Array = field(default_factory=lambda: np.zeros(0))
    """[N m]"""
    largest_thrust: float = 1.0
    largest_torque: float = 0.03


@dataclass(frozen=True)
class Draws:
    """Standard normal random numbers."""

    propeller: Array
    """(P, 2)"""
    run: Array
    """(R, 2)"""
    point: Array
    """(N,)"""
    share: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(R, 2) of the runs' shares; empty: zero."""

    @classmethod
    def none(cls, setup: Setup) -> Draws:
        """Return draws of zero."""
        return cls(
            np.zeros((int(setup.propeller.max(initial=0)) + 1, 2)),
            np.zeros((int(setup.run.max(initial=0)) + 1, 2)),
            np.zeros(setup.speed.size),
            np.zeros((int(setup.run.max(initial=0)) + 1, 2)),
        )


def nulls() -> dict[str, tuple[float, ...]]:
    """Return every effect's parameters at their null values."""
    return {name: tuple(p.null for p in e.theta) for name, e in STAND_EFFECTS.items()}


def predict(
    setup: Setup, theta: Mapping[str, tuple[float, ...]], draws: Draws | None = None
) -> Array:
    """Return the readings (N, 4) in the order of `CHANNELS`: N, N m, rad, rad/s.

    Points at which the law has no valid root are NaN.

    Args:
        setup: the operating points.
        theta: effect -> its parameters, in their order; missing parameters have their null values.
        draws: of the random effects; None: zero.
    """
    drawn = draws or Draws.none(setup)
    m = _begin(setup, drawn)
    _apply(StandStage.SPEED, m, theta)
    _apply(StandStage.PROPELLER, m, theta)
    _solve(setup, m)
    _apply(StandStage.LOAD, m, theta)
    m.thrust = m.thrust + m.applied_thrust
    m.torque = m.torque + m.applied_torque
    m.reference_speed = m.speed.copy()
    _apply(StandStage.READING, m, theta)
    return np.column_stack([getattr(m, name) for name in CHANNELS])


def _begin(setup: Setup, draws: Draws) -> StandRun:
    n = setup.speed.size
    zero = np.zeros(n)
    return StandRun(
        speed=setup.speed.copy(),
        rows=setup.rows.copy(),
        plain=setup.plain,
        share=np.ones(n),
        other_law=zero.copy(),
        inflow=zero.copy(),
        exponent=zero.copy(),
        elapsed=setup.elapsed,
        applied_thrust=setup.applied_thrust if setup.applied_thrust.size else zero,
        applied_torque=setup.applied_torque if setup.applied_torque.size else zero,
        propeller_draws=draws.propeller[setup.propeller],
        run_draws=draws.run[setup.run],
        share_draws=draws.share[setup.run] if draws.share.size else np.zeros((n, 2)),
        point_draws=draws.point,
        thrust=zero.copy(),
        torque=zero.copy(),
        beta=zero.copy(),
        reference_speed=zero.copy(),
        largest_thrust=setup.largest_thrust,
        largest_torque=setup.largest_torque,
    )


def _apply(stage: StandStage, m: StandRun, theta: Mapping[str, tuple[float, ...]]) -> None:
    for name, effect in STAND_EFFECTS.items():
        if effect.stage == stage and name in theta:
            values = theta[name]
            if any(v != p.null for v, p in zip(values, effect.theta, strict=True)):
                effect.function(m, *values)


def _solve(setup: Setup, m: StandRun) -> None:
    if m.plain:
        middle = float(np.median(m.speed[m.speed > 0.0])) if (m.speed > 0.0).any() else 1.0
        ratio = np.where(m.speed > 0.0, m.speed / middle, 1.0) ** m.exponent
        m.thrust = m.rows[:, 0] * m.speed**2 * ratio
        m.torque = m.rows[:, 1] * m.speed**2 * ratio
        return
    thrust, torque, beta = _both_laws(setup, m)
    if m.inflow.any():
        straight = m.rows.copy()
        velocity = np.zeros_like(thrust)
        for _ in range(3):  # thrust and inflow settle to 1e-3 of each other
            m.rows[:] = straight
            known = np.nan_to_num(thrust)  # points without a root stay without one
            velocity = turn_inflow(
                m, known, setup.tip_radius_m, _INFLOW_RADIUS * setup.tip_radius_m
            )
            thrust, torque, beta = _both_laws(setup, m)
        turning = np.maximum(m.speed, 1e-9)
        torque = torque + np.where(m.speed > 0.0, thrust * velocity / turning, 0.0)
    m.thrust, m.torque, m.beta = thrust, torque, beta


def _both_laws(setup: Setup, m: StandRun) -> tuple[Array, Array, Array]:
    loads = _loads(setup.law, m)
    if not m.other_law.any():
        return loads
    other_loads = _loads(_OTHER_LAW[setup.law], m)
    b = m.other_law
    first, second, third = ((1.0 - b) * x + b * y for x, y in zip(loads, other_loads, strict=True))
    return first, second, third


def _loads(law: str, m: StandRun) -> tuple[Array, Array, Array]:
    """Return thrust [N], torque [N m] and flap angle [rad], with the shared load undone."""
    speed = np.where(m.speed <= SPEED_LIMIT, m.speed, np.nan)
    points = evaluate_rows(m.rows, np.nan_to_num(speed), law, "mask")
    thrust = points.thrust_N
    if (m.share != 1.0).any():
        inner = m.rows[:, SCALARS["air_density"]] * speed**2
        inner = inner * m.rows[:, SCALARS["inner_thrust"]]
        thrust = inner + (thrust - inner) / m.share
    thrust = np.where(np.isnan(speed), np.nan, thrust)
    return thrust, points.torque_Nm, points.beta_rad
