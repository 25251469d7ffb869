"""The vehicle file: airframe, propeller and gains of one vehicle, each value with its source.

`tombo fly --vehicle`, a scenario's `vehicle:` and `tombo diagnose --vehicle` read it; presets are
such files under `vehicles/`. Values that a file leaves out are the default vehicle's, scaled to
its size (`similar_vehicle`); gains that it leaves out follow from the vehicle (`gains_for`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tombo_control.loops.loop_design import gains_for
from tombo_control.params import ControlParams
from tombo_dynamics.effects import check_theta
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number, from_mapping
from tombo_dynamics.propeller.mounted_propeller import (
    PlainPropeller,
    PropellerChoice,
    check_choice,
    mounted_configuration,
    mounted_rotors,
    mounted_vehicle,
    thrust_map_of,
)
from tombo_dynamics.rotor_maps import RotorMaps, rotor_maps
from tombo_dynamics.vehicle import DriveParams, VehicleParams, similar_vehicle
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.builtin_files import VEHICLES, builtin_file, builtin_vehicles
from tombo_flight.yaml_file import check_keys, list_of, mapping_of, write_yaml, yaml_of

FORMAT = 1
_SECTIONS: dict[str, type[Any]] = {
    "vehicle": VehicleParams,
    "propeller": PropellerChoice,
    "control": ControlParams,
    "drive": DriveParams,
}
_KEYS = ("tombo_vehicle", "name", "about", *_SECTIONS, "effects", "sources", "healthy")
_HEALTHY_KEYS = ("flights", "left_out", "accused", "spread", "residuals")
_HEAD = (
    "# A vehicle. Fly it: tombo fly hover --vehicle THIS_FILE. docs/own_vehicle.md says what\n"
    "# each value means, and what is taken where one is left out.\n"
)
_TOLERANCE = (1e-15, 1e6)
"""Bounds; 0 would say that a value can't be wrong at all."""
EFFECT_OF = {
    "vehicle.mass": ("mass_error.fraction", True),
    "vehicle.inertia_xx": ("inertia_error.xx", True),
    "vehicle.inertia_yy": ("inertia_error.yy", True),
    "vehicle.inertia_zz": ("inertia_error.zz", True),
    "vehicle.motor_time_constant": ("motor_lag.extra_tau", False),
    "propeller.k_thrust": ("thrust_coefficient_error.fraction", True),
    "propeller.curve": ("thrust_coefficient_error.fraction", False),
    "drive.gain": ("thrust_coefficient_error.fraction", True),
    "drive.curvature": ("thrust_coefficient_error.fraction", True),
}
"""Value of a vehicle file → the effect that its error is, and whether as a share of the value."""
_ACCEPTED = "a vehicle file as `tombo vehicle new` writes it"


@dataclass(frozen=True)
class Note:
    """How well a value is known, and from where."""

    tolerance: float | None = None
    """One standard deviation, in the unit of the value; None: as for the suite's own vehicle."""
    source: str = ""


@dataclass(frozen=True)
class HealthyFlights:
    """Residual of healthy flights of a vehicle."""

    flights: int
    residuals: Mapping[str, tuple[float, ...]]
    """Channel of the diagnosis → variances of its residual by time scale, in its unit squared."""
    spread: Mapping[str, float] = field(default_factory=dict)
    """effect.parameter → standard deviation with which it differs from flight to flight."""
    left_out: int = 0
    """Flights that were diagnosed with the vehicle that the others show."""
    accused: int = 0
    """Number of these healthy flights in which the diagnosis found a fault."""


@dataclass(frozen=True)
class VehicleFile:
    """A vehicle, complete and checked."""

    name: str
    vehicle: VehicleParams
    propeller: PropellerChoice
    control: ControlParams
    drive: DriveParams = field(default_factory=DriveParams)
    """Effect of a motor command, where logs have no rotor speeds."""
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Effects of the vehicle, in place of a scenario's: its drag, for example."""
    given: frozenset[str] = frozenset()
    """section.key of the values in the file itself; the rest follows from it."""
    notes: Mapping[str, Note] = field(default_factory=dict)
    """section.key → its note."""
    about: str = ""
    sources: tuple[str, ...] = ()
    """Sources of [1], [2] and so on in the notes."""
    healthy: HealthyFlights | None = None
    """Healthy flights of a vehicle that was fitted to them."""

    @property
    def maps(self) -> RotorMaps:
        """The table of its rotors."""
        return mounted_rotors(self.propeller, self.vehicle)

    def tolerance(self, key: str) -> float | None:
        """Return the noted standard deviation of section.key; None: there is none."""
        return self.notes.get(key, Note()).tolerance


def read_vehicle(name: str) -> VehicleFile:
    """Read and check a vehicle by name (built in) or path.

    Raises:
        InputError: there is none, it has no vehicle, unknown keys, or values that no
            simulation takes.
    """
    if (file := builtin_file(VEHICLES, name)) is not None:
        return vehicle_from_text(file.read_text(encoding="utf-8"), f"vehicle '{name}'")
    path = Path(name)
    if path.suffix not in (".yaml", ".yml") and not path.exists():
        raise unknown_name("vehicle", name, builtin_vehicles())
    what = f"vehicle file '{name}'"
    return vehicle_from_text(read_text(path, what, _ACCEPTED), what, path.parent)


def vehicle_named(vehicle: str | VehicleFile) -> VehicleFile:
    """Return a vehicle that is given, or the one of a name or path: see `read_vehicle`."""
    return vehicle if isinstance(vehicle, VehicleFile) else read_vehicle(vehicle)


def vehicle_from_text(text: str, what: str, folder: Path = Path()) -> VehicleFile:
    """Return the vehicle that a file's text holds.

    Args:
        text: of the file.
        what: names it in errors.
        folder: base of the path of a propeller's library.

    Raises:
        InputError: as `read_vehicle`.
    """
    values = parse_yaml(text, what)
    if not isinstance(values, Mapping) or "tombo_vehicle" not in values:
        raise InputError(f"{what}: no key tombo_vehicle; accepted: {_ACCEPTED}")
    return vehicle_from_mapping(values, what, folder)


def vehicle_from_mapping(
    values: Mapping[str, Any], what: str, folder: Path = Path()
) -> VehicleFile:
    """Return the vehicle from the plain values of a file.

    Raises:
        InputError: as `read_vehicle`.
    """
    check_keys(values, _KEYS, what)
    if values.get("tombo_vehicle") != FORMAT:
        found = shown(values.get("tombo_vehicle"))
        raise InputError(f"{what}: tombo_vehicle: {found}; accepted: {FORMAT}")
    plain: dict[str, dict[str, Any]] = {}
    notes: dict[str, Note] = {}
    for section in _SECTIONS:
        plain[section], noted = _without_notes(values.get(section), section, what)
        notes |= noted
    if "mass" not in plain["vehicle"]:
        raise InputError(f"{what}: vehicle.mass: missing; accepted: a number [kg]")
    if not plain["propeller"]:
        raise InputError(
            f"{what}: propeller: missing; accepted: conf, or k_thrust and k_torque, or curve"
        )
    library = plain["propeller"].get("library")
    if isinstance(library, str) and library:
        plain["propeller"]["library"] = str(folder / library)
    try:
        return _built(values, plain, notes)
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def _built(
    values: Mapping[str, Any], plain: Mapping[str, Mapping[str, Any]], notes: Mapping[str, Note]
) -> VehicleFile:
    """Return the vehicle from values without notes, completed with defaults."""
    propeller = from_mapping(PropellerChoice, plain["propeller"], "propeller")
    check_choice(propeller)
    given = from_mapping(VehicleParams, plain["vehicle"], "vehicle")
    radius = propeller.radius
    if "rotor_radius" in plain["vehicle"]:
        radius = radius or given.rotor_radius
    if not radius:
        if propeller.plain:
            raise InputError("propeller.radius: missing; accepted: the tip radius [m]")
        radius = mounted_configuration(propeller).blade.tip_radius_m
    rotor = thrust_map_of(propeller)
    speed = None
    if isinstance(rotor, PlainPropeller):
        speed = rotor.speed_for(given.hover_thrust())
    like = similar_vehicle(given.mass, given.arm_length, radius, speed)
    vehicle = from_mapping(
        VehicleParams, {**dataclasses.asdict(like), **plain["vehicle"]}, "vehicle"
    )
    vehicle = mounted_vehicle(vehicle, propeller)
    gains = gains_for(vehicle, rotor_maps(rotor, vehicle))
    control = from_mapping(
        ControlParams, {**dataclasses.asdict(gains), **plain["control"]}, "control"
    )
    effects = values.get("effects")
    return VehicleFile(
        str(values.get("name") or "vehicle"),
        vehicle,
        propeller,
        control,
        from_mapping(DriveParams, plain["drive"], "drive"),
        {} if effects is None else check_theta(_of_effects(effects), "effects"),
        frozenset(f"{s}.{key}" for s, inner in plain.items() for key in inner),
        notes,
        str(values.get("about") or ""),
        tuple(str(source) for source in list_of(values.get("sources"), "sources")),
        _healthy(values.get("healthy")),
    )


def _healthy(content: Any) -> HealthyFlights | None:
    """Return what healthy flights left.

    Raises:
        InputError: no number of flights, or variances that are none.
    """
    if content is None:
        return None
    values = mapping_of(content, "healthy")
    check_keys(values, _HEALTHY_KEYS, "healthy")
    try:
        return HealthyFlights(
            int(values["flights"]),
            {str(name): tuple(map(float, of)) for name, of in values["residuals"].items()},
            {str(label): float(v) for label, v in (values.get("spread") or {}).items()},
            int(values.get("left_out", 0)),
            int(values.get("accused", 0)),
        )
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise InputError(f"healthy: {error}; accepted: what `tombo vehicle fit` writes") from None


def _of_effects(given: Any) -> Mapping[str, Mapping[str, float]]:
    for name, theta in mapping_of(given, "effects").items():
        mapping_of(theta, f"effects.{name}")
    return dict(given)


def _without_notes(
    content: Any, section: str, what: str
) -> tuple[dict[str, Any], dict[str, Note]]:
    """Return the values of a section, and the notes on them.

    Raises:
        InputError: an unknown key, or a note that is none.
    """
    record = _SECTIONS[section]
    values = mapping_of({} if content is None else content, f"{what}: {section}")
    check_keys(values, [f.name for f in dataclasses.fields(record)], f"{what}: {section}")
    units = {f.name: f.metadata.get("unit", "1") for f in dataclasses.fields(record)}
    plain: dict[str, Any] = {}
    notes: dict[str, Note] = {}
    for key, value in values.items():
        if not isinstance(value, Mapping):
            plain[key] = value
            continue
        where = f"{what}: {section}.{key}"
        check_keys(value, ("value", "tolerance", "source"), where)
        if "value" not in value:
            raise InputError(
                f"{where}: no value; accepted: {{value: .., tolerance: .., source: ..}}"
            )
        plain[key] = value["value"]
        tolerance = value.get("tolerance")
        if tolerance is not None:
            tolerance = check_number(f"{where}.tolerance", tolerance, units[key], _TOLERANCE)
        notes[f"{section}.{key}"] = Note(tolerance, str(value.get("source") or ""))
    return plain, notes


def vehicle_text(file: VehicleFile) -> str:
    """Return the text of a vehicle file: the given values, with notes."""
    values: dict[str, Any] = {"tombo_vehicle": FORMAT, "name": file.name}
    if file.about:
        values["about"] = file.about
    for section in _SECTIONS:
        record = getattr(file, section)
        said = [f for f in dataclasses.fields(record) if f"{section}.{f.name}" in file.given]
        if said:
            values[section] = {
                f.name: _noted(getattr(record, f.name), file.notes.get(f"{section}.{f.name}"))
                for f in said
            }
    if file.effects:
        values["effects"] = file.effects
    if file.sources:
        values["sources"] = list(file.sources)
    if file.healthy is not None:
        values["healthy"] = {key: getattr(file.healthy, key) for key in _HEALTHY_KEYS}
    return f"{_HEAD}{yaml_of(values)}"


def _noted(value: Any, note: Note | None) -> Any:
    if note is None:
        return value
    noted: dict[str, Any] = {"value": value}
    if note.tolerance is not None:
        noted["tolerance"] = note.tolerance
    if note.source:
        noted["source"] = note.source
    return noted


def write_vehicle(path: Path, file: VehicleFile) -> None:
    """Write a vehicle file, whole or not at all.

    Raises:
        InputError: the file can't be written.
    """
    write_yaml(path, vehicle_text(file), f"vehicle file '{path}'")
