"""The simulation that flights are compared with: a vehicle, its rotors, the effects it knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from tombo_diagnosis.engine.regression import Parameter
from tombo_diagnosis.flight.fit.parameters import parameters
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.effects.compose import SimulatedPlant, new_plant, pack_theta
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.vehicle_file import HealthyFlights

_BEYOND = 4.0
"""Tolerances that a size which clearly matters has at least."""


@dataclass(frozen=True)
class NominalModel:
    """A model of the vehicle, as it is simulated before the diagnosis."""

    label: str
    vehicle: VehicleParams
    maps: RotorMaps
    """The rotor's table, `tombo_dynamics.rotor_maps`."""
    effects: Mapping[str, Mapping[str, float]]
    """What it knows of effects, with their parameters."""
    calibrated: bool = False
    """True: thrust was fitted to the same flights; mass and thrust errors can't be seen then, and
    what healthy flights of this vehicle look like is not known."""
    fitted: frozenset[str] = frozenset()
    """effect.parameter of what that fit has absorbed: free at all times, and never a cause."""
    moments: bool = True
    """False: arms and inertia are not known; moments are not compared."""
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """effect.parameter → standard deviation with which this vehicle's own value is known."""
    healthy: HealthyFlights | None = None
    """What this model leaves unexplained of the vehicle's healthy flights; None: not known."""
    vehicle_name: str = ""
    """Of a vehicle file; empty: the suite's own vehicle."""

    @property
    def theta(self) -> Array:
        """Parameters of all effects, packed."""
        return pack_theta(self.effects)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters of theta, with sizes that matter for this vehicle."""
        return tuple(
            _known_to(p, self.tolerances.get(p.label))
            for p in parameters(self.vehicle.mass, self.vehicle.arm_length)
        )

    def plant(self, draws: Array | None = None) -> SimulatedPlant:
        """Return a fresh plant with the flight's draws (8), or none."""
        plant = new_plant(self.vehicle)
        if draws is not None:
            plant.draws = draws
        return plant


def nominal_tolerances(nominal: NominalModel) -> dict[str, float]:
    """Return effect.parameter → standard deviation within which a value may be off unnoticed.

    Of effects without contact; what was fitted to the flights has none. The scatter of the
    propellers is the nominal one, where there is some.
    """
    found = {
        p.label: p.tolerance
        for p in nominal.parameters
        if not REGISTRY[p.effect].contact and p.label not in nominal.fitted
    }
    scatter = nominal.effects.get("thrust_scatter", {}).get("deviation", 0.0)
    return found | ({"thrust_scatter.deviation": scatter} if scatter > 0.0 else {})


def _known_to(p: Parameter, tolerance: float | None) -> Parameter:
    """Return a parameter with this vehicle's own tolerance; what matters is well beyond it."""
    if tolerance is None:
        return p
    return replace(p, known_to=tolerance, scale=max(p.scale, _BEYOND * tolerance))
