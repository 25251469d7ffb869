"""The parameters that a diagnosis of flights frees: all of the registry."""

from __future__ import annotations

from tombo_diagnosis.engine.regression import Parameter
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.effects.compose import layout
from tombo_dynamics.effects.vehicle_size import size_factors
from tombo_dynamics.vehicle import VehicleParams

_OWN = VehicleParams()
"""The vehicle that the registry's typical sizes are for."""


def parameters(mass: float = _OWN.mass, arm: float = _OWN.arm_length) -> tuple[Parameter, ...]:
    """Return all parameters of the registry, in the order of theta.

    What clearly matters is given for the suite's own vehicle: forces grow with the mass [kg],
    lengths with the arm, centre to rotor axis [m].
    """
    sizes = size_factors(mass, arm)
    found = []
    places = layout()
    for name, effect in REGISTRY.items():
        for p in effect.theta:
            alike = [abs(o.typical - o.null) for o in effect.theta if o.unit == p.unit]
            scale = abs(p.typical - p.null) or max(alike) or abs(p.typical) or 1.0
            place = places[name][p.name]
            if not name.startswith(("mocap_noise", "contact")):
                scale *= sizes.get(p.unit, 1.0)
            found.append(Parameter(place, name, p.name, p.unit, p.null, *p.bounds, scale))
    return tuple(sorted(found, key=lambda p: p.index))


PARAMETERS = parameters()
