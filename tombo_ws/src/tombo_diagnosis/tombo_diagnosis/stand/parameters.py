"""Parameters of a stand diagnosis, and the healthy widths of stochastic effects."""

from __future__ import annotations

from tombo_diagnosis.engine.regression import Parameter
from tombo_dynamics.propeller.effects import STAND_EFFECTS, Setup

_OWN_THRUST, _OWN_TORQUE = 3.0, 0.12
"""N and N m: the largest loads of the stand that the registry's typical sizes are for."""


def parameters(setup: Setup) -> tuple[Parameter, ...]:
    """Return the parameters of all effects that make sense for a setup's model."""
    model = "plain" if setup.plain else "tombo"
    scales_with = {
        "": 1.0,
        "thrust": setup.largest_thrust / _OWN_THRUST,
        "torque": setup.largest_torque / _OWN_TORQUE,
    }
    found: list[Parameter] = []
    for name, effect in STAND_EFFECTS.items():
        for p in effect.theta if effect.suits(model) else ():
            scale = abs(p.typical - p.null) * scales_with[p.scales_with]
            place = -1 if effect.stochastic else sum(not q.stochastic for q in found)
            found.append(
                Parameter(place, name, p.name, p.unit, p.null, *p.bounds, scale, effect.stochastic)
            )
    return tuple(found)


HEALTHY_SHARE = {
    "fabrication_scatter": 0.125, "tare_scatter": 0.05, "speed_noise": 0.05, "run_scatter": 0.125,
}  # fmt: skip
"""Widths of stochastic effects on a healthy stand, in sizes that matter: 1 % between propellers,
half a percent between runs."""
