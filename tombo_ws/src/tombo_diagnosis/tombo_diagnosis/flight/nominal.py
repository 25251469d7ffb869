"""The simulation that flights are compared with: a vehicle, its rotors, the effects it knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy import stats

from tombo_bag.flight import Flight
from tombo_diagnosis.engine.regression import FreeParameter
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.effects.compose import SimulatedPlant, layout, new_plant, pack_theta
from tombo_dynamics.effects.registry import size_factors
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_rotors
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.scenario import Scenario, load_scenario, world_of
from tombo_flight.vehicle_file import EFFECT_OF, HealthyFlights, VehicleFile, vehicle_named
from tombo_logs.readers.vehicle_airframe import airframe_of
from tombo_sim.propeller_effects import vehicle_effects

_NOMINAL_VEHICLE = VehicleParams()
"""The vehicle that the registry's typical sizes are for."""


def parameters(
    mass: float = _NOMINAL_VEHICLE.mass, arm: float = _NOMINAL_VEHICLE.arm_length
) -> tuple[FreeParameter, ...]:
    """Return all parameters of the registry, in the order of theta.

    What clearly matters is given for the suite's own vehicle: forces grow with the mass [kg],
    lengths with the arm, centre to rotor axis [m].
    """
    sizes = size_factors(mass, arm)
    every = []
    places = layout()
    for name, effect in REGISTRY.items():
        for p in effect.theta:
            scale = effect.size(p)
            place = places[name][p.name]
            if not name.startswith(("mocap_noise", "contact")):
                scale *= sizes.get(p.unit, 1.0)
            every.append(
                FreeParameter(
                    place, name, p.name, p.unit, p.null, *p.bounds, scale,
                    healthy_spread=effect.healthy_spread,
                )
            )  # fmt: skip
    return tuple(sorted(every, key=lambda p: p.index))


PARAMETERS = parameters()


_OTHER_VEHICLES = 4.0
"""Flights that the usual tolerances weigh."""
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
    """Known effects, with their parameters."""
    calibrated: bool = False
    """True: thrust was fitted to the same flights; mass and thrust errors can't be seen then, and
    what healthy flights of this vehicle look like is not known."""
    fitted: frozenset[str] = frozenset()
    """effect.parameter that the fit has absorbed: free at all times, and never a cause."""
    moments: bool = True
    """False: arms and inertia are not known; moments are not compared."""
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """effect.parameter → standard deviation with which this vehicle's own value is known."""
    healthy: HealthyFlights | None = None
    """Residual of the vehicle's healthy flights; None: not known."""
    vehicle_name: str = ""
    """Name of a vehicle file; empty: the suite's own vehicle."""

    @property
    def theta(self) -> Array:
        """Parameters of all effects, packed."""
        return pack_theta(self.effects)

    @cached_property
    def parameters(self) -> tuple[FreeParameter, ...]:
        """All parameters of theta, with sizes that matter for this vehicle."""
        return tuple(
            replace(
                _known_to(p, self.tolerances.get(p.label)),
                tolerance_inflation=self.tolerance_inflation,
            )
            for p in parameters(self.vehicle.mass, self.vehicle.arm_length)
        )

    @cached_property
    def scatter(self) -> FreeParameter:
        """The parameter that says how much the rotors of a vehicle differ."""
        return next(p for p in self.parameters if p.label == SCATTER_LABEL)

    @cached_property
    def tolerance_inflation(self) -> float:
        """Factor by which tolerances may be too small, as far as the vehicle's flights tell.

        That of a standard deviation at its upper 97.5 % bound, other vehicles counted, too.
        """
        if self.healthy is None:
            return 1.0
        degrees = _OTHER_VEHICLES + self.healthy.flights
        return float(np.sqrt(degrees / stats.chi2.ppf(0.025, degrees)))

    def plant(self, draws: Array | None = None) -> SimulatedPlant:
        """Return a fresh plant with the flight's draws (8), or none."""
        plant = new_plant(self.vehicle)
        if draws is not None:
            plant.draws = draws
        return plant


def nominal_tolerances(nominal: NominalModel) -> dict[str, float]:
    """Return effect.parameter → standard deviation within which a value may be off unnoticed.

    Fitted parameters have none. The scatter of the propellers is the nominal one,
    where there is some, or what healthy flights differ by.
    """
    tolerances = {
        p.label: p.tolerance
        for p in nominal.parameters
        if p.tolerance > 0.0 and p.label not in nominal.fitted
    }
    scatter = nominal.effects.get("thrust_scatter", {}).get("deviation", 0.0)
    scatter = max(scatter, nominal.tolerances.get(SCATTER_LABEL, 0.0))
    return tolerances | ({SCATTER_LABEL: scatter} if scatter > 0.0 else {})


def _known_to(p: FreeParameter, tolerance: float | None) -> FreeParameter:
    """Return a parameter with this vehicle's own tolerance; what matters is well beyond it."""
    if tolerance is None:
        return p
    return replace(p, known_to=tolerance, scale=max(p.scale, _BEYOND * tolerance))


SCATTER = "thrust_scatter"
"""The effect of the vehicle's draws."""
SCATTER_LABEL = f"{SCATTER}.deviation"
"""The parameter that says how much the rotors of a vehicle differ."""
_SCENARIO = "no_obstacle"


def nominal_model(
    model: Path | None = None, vehicle: str | VehicleFile | None = None
) -> NominalModel:
    """Return a vehicle without an obstacle, extended by a model file if given.

    Args:
        model: a `model.yaml`.
        vehicle: a vehicle file, or its name or path; None: the suite's own vehicle.

    Raises:
        InputError: a file can't be used.
    """
    scenario = load_scenario(
        _SCENARIO, model=None if model is None else str(model), vehicle=vehicle
    )
    label = _SCENARIO if model is None else f"{_SCENARIO} with {model.name}"
    if vehicle is None:
        return nominal_of(scenario, label)
    file = vehicle_named(vehicle)
    foreign = (file.vehicle, file.propeller) != (VehicleParams(), PropellerChoice())
    return replace(
        nominal_of(scenario, f"{file.name}, {label}"),
        tolerances=_with_spread(tolerances_of(file), file),
        healthy=file.healthy,
        vehicle_name=file.name if foreign else "",
    )


def tolerances_of(file: VehicleFile) -> dict[str, float]:
    """Return effect.parameter → standard deviation, of the values that have a tolerance.

    A tolerance of arms, rotor inertia or drag torque has no effect in the registry.
    """
    tolerances = {}
    for key, (label, share) in EFFECT_OF.items():
        tolerance = file.tolerance(key)
        if tolerance is None:
            continue
        section, _, name = key.partition(".")
        value = getattr(getattr(file, section), name) if share else 1.0
        tolerances[label] = tolerance / value
    return tolerances


def _with_spread(tolerances: Mapping[str, float], file: VehicleFile) -> dict[str, float]:
    """Return tolerances, none below what differs from one healthy flight to the next."""
    spread = {} if file.healthy is None else file.healthy.spread
    usual = parameters(file.vehicle.mass, file.vehicle.arm_length)
    usual_tolerances = {p.label: p.tolerance for p in usual}
    widened = dict(tolerances)
    for label, deviation in spread.items():
        widened[label] = max(deviation, widened.get(label, usual_tolerances.get(label, 0.0)))
    return widened


def held_against(logs: Sequence[Flight], file: VehicleFile) -> list[Flight]:
    """Return flights so that they are held against a vehicle file, whatever airframe they name.

    Where rotor speeds are there, its own thrust is flown; where only motor commands are, what its
    drive makes of them. Without a drive its mass, arms and inertia are used, and thrust is fitted
    to the flights; where no flight has commands, there is nothing to fit it to.
    """
    if file.drive.known:
        logs = [_with_drive(log, file) for log in logs]
    frame = None
    driven = any("motor_command" in log.series for log in logs)
    if driven and not all(log.has_rotor_speeds for log in logs):
        frame = airframe_of(file)
    return [replace(log, airframe=frame) for log in logs]


def _with_drive(log: Flight, file: VehicleFile) -> Flight:
    """Return a log with its motor commands as the rotor speeds that give their thrust.

    The drive has taken up what the supply does to it: a battery that sags besides would do it
    twice.
    """
    command = log.series.get("motor_command")
    if command is None or "rotor_command" in log.series:
        return log
    voltage = None
    supply = log.series.get("voltage")
    if supply is not None and np.isfinite(supply.values[:, 0]).any():
        good = np.isfinite(supply.values[:, 0])
        voltage = np.interp(command.t, supply.t[good], supply.values[good, 0])
    maps = file.maps
    thrust = file.drive.thrust(command.values, voltage)
    speeds = [speed_for_thrust(maps, value) for value in thrust.ravel()]
    asked = replace(command, values=np.reshape(speeds, thrust.shape))
    series = {key: each for key, each in log.series.items() if key != "voltage"}
    return log.with_series({**series, "rotor_command": asked})


def nominal_of(scenario: Scenario, label: str) -> NominalModel:
    """Return the nominal model of a scenario: its vehicle, propeller and effects."""
    world = world_of(scenario)
    return NominalModel(
        label,
        world.vehicle,
        mounted_rotors(world.propeller, world.vehicle),
        vehicle_effects(world.propeller, world.vehicle, world.effects),
    )
