"""The nominal model that `tombo diagnose` holds flights against, from a scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tombo_bag.flight import Flight
from tombo_diagnosis.flight.fit.parameters import parameters
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_rotors
from tombo_dynamics.rotor_maps import speed_for_thrust
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.scenario import Scenario, load_scenario, world_of
from tombo_flight.vehicle_file import EFFECT_OF, VehicleFile, vehicle_named
from tombo_logs.readers.vehicle_airframe import airframe_of
from tombo_sim.propeller_effects import vehicle_effects

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

    A tolerance of arms, rotor inertia or drag torque has no effect that stands for it.
    """
    found = {}
    for key, (label, share) in EFFECT_OF.items():
        tolerance = file.tolerance(key)
        if tolerance is None:
            continue
        section, _, name = key.partition(".")
        value = getattr(getattr(file, section), name) if share else 1.0
        found[label] = tolerance / value
    return found


def _with_spread(tolerances: Mapping[str, float], file: VehicleFile) -> dict[str, float]:
    """Return tolerances, none below what differs from one healthy flight to the next."""
    spread = {} if file.healthy is None else file.healthy.spread
    usual = parameters(file.vehicle.mass, file.vehicle.arm_length)
    own = {p.label: p.tolerance for p in usual}
    found = dict(tolerances)
    for label, deviation in spread.items():
        found[label] = max(deviation, found.get(label, own.get(label, 0.0)))
    return found


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
