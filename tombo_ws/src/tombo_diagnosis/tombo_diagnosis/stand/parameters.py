"""The parameters that a stand diagnosis frees, with what is taken for granted."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.propeller.effects import STAND_EFFECTS, Setup

TOLERANCE = 0.05
"""Share of the size that matters which is no finding: as for flights."""
_OWN_THRUST, _OWN_TORQUE = 3.0, 0.12
"""N and N m: the largest loads of the stand that the registry's typical sizes are for."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of one effect."""

    effect: str
    name: str
    unit: str
    null: float
    low: float
    high: float
    scale: float
    """A change of this size clearly matters."""
    stochastic: bool

    @property
    def label(self) -> str:
        """effect.name."""
        return f"{self.effect}.{self.name}"

    @property
    def tolerance(self) -> float:
        """Standard deviation of what counts as healthy."""
        return TOLERANCE * self.scale


def parameters(setup: Setup) -> tuple[Parameter, ...]:
    """Return the parameters of all effects that make sense for a setup's model."""
    model = "plain" if setup.plain else "tombo"
    scales_with = {
        "": 1.0,
        "thrust": setup.largest_thrust / _OWN_THRUST,
        "torque": setup.largest_torque / _OWN_TORQUE,
    }
    return tuple(
        Parameter(
            name, p.name, p.unit, p.null, *p.bounds,
            abs(p.typical - p.null) * scales_with[p.scales_with], effect.stochastic,
        )
        for name, effect in STAND_EFFECTS.items()
        if model in effect.models
        for p in effect.theta
    )  # fmt: skip


HEALTHY_SHARE = {
    "fabrication_scatter": 0.125, "tare_scatter": 0.05, "speed_noise": 0.05, "run_scatter": 0.125,
}  # fmt: skip
"""Width of what chance does on a healthy stand, in sizes that matter: 1 % between propellers,
half a percent between runs."""
