"""A design as files that `tombo fly` takes: a scenario and, where it needs one, a library."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import yaml

from tombo_dynamics.propeller import Configuration, read_library
from tombo_dynamics.vehicle import VehicleParams
from tombo_propeller.design.request import DesignRequest, vehicle_for

SCENARIO = "design.yaml"
LIBRARY = "library"
LIBRARY_FILES = ("materials.yaml", "blades.yaml", "configurations.yaml", "measurements.yaml")
_CONTACT_X = 1.7
"""Where the vehicle is when it touches, x_c of the paper's flight [m]."""
_PILLAR_RADIUS = 0.25
_TOWARDS = (0.3469, 0.1003)
"""Vector from the front-left hub to the pillar's axis in the paper's scenario [m]."""


def is_built_in(configuration: Configuration) -> bool:
    """Return whether a configuration is one of the paper's, unchanged."""
    return read_library().configurations.get(configuration.number) == configuration


def scenario_of(
    request: DesignRequest, configuration: Configuration, force_N: float, recovery_s: float
) -> dict[str, Any]:
    """Return the paper's collision flight with the vehicle and the propeller of a design.

    The pillar moves so that the front-left disc touches it at the same place, x_c.

    Args:
        request: mass, frame and law.
        configuration: the propeller.
        force_N: collision force that its blades push with.
        recovery_s: their recovery time.
    """
    vehicle = vehicle_for(request, configuration.blade)
    propeller: dict[str, Any] = {"conf": configuration.number, "law": request.law}
    if not is_built_in(configuration):
        propeller["library"] = LIBRARY
    hub = vehicle.arm_length / math.sqrt(2.0)
    reach = (_PILLAR_RADIUS + vehicle.rotor_radius) / math.hypot(*_TOWARDS)
    plain = VehicleParams()
    changed = {
        field.name: round(float(getattr(vehicle, field.name)), 9)
        for field in dataclasses.fields(vehicle)
        if getattr(vehicle, field.name) != getattr(plain, field.name)
    }
    return {
        "extends": "paper_collision",
        "description": f"The paper's collision with {request.mass_kg:g} kg on arms of "
        f"{1e3 * request.arm_m:g} mm and the nodus designed for it.",
        "propeller": propeller,
        "vehicle": changed,
        "obstacle": {
            "x": round(_CONTACT_X + hub + reach * _TOWARDS[0], 4),
            "y": round(hub + reach * _TOWARDS[1], 4),
            "radius": _PILLAR_RADIUS,
        },
        "effects": {
            "blade_strike": {
                "peak_force": round(float(force_N), 4),
                "recovery_time": round(float(recovery_s), 4),
            }
        },
    }


def library_texts(configuration: Configuration) -> dict[str, str]:
    """Return file name → text of a library with one configuration and its materials."""
    nodus = configuration.nodus
    assert nodus is not None
    row: dict[str, Any] = {
        "conf": configuration.number,
        "blade": configuration.blade.name,
        "matrix": nodus.matrix.name,
        "fibre": nodus.fibre.name,
        "fibres": nodus.fibres,
        "fibre_diameter_mm": nodus.fibre_diameter_mm,
        "length_mm": nodus.length_mm,
    }
    if configuration.edge is not None and configuration.edge == nodus.matrix.name:
        row["edge"] = configuration.edge
    contents: dict[str, Any] = {
        "materials.yaml": {
            "matrices": {nodus.matrix.name: _values(nodus.matrix)},
            "fibres": {nodus.fibre.name: _values(nodus.fibre)},
        },
        "blades.yaml": {configuration.blade.name: _values(configuration.blade)},
        "configurations.yaml": [row],
    }
    if configuration.measured is not None:
        measured = {"conf": configuration.number, **_values(configuration.measured)}
        contents["measurements.yaml"] = {"at_2000_rpm": [measured]}
    return {
        name: yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=99)
        for name, content in contents.items()
    }


def scenario_text(scenario: dict[str, Any]) -> str:
    """Return a scenario as the text of a file."""
    text: str = yaml.safe_dump(scenario, sort_keys=False, allow_unicode=True, width=99)
    return f"# Fly it: tombo fly {SCENARIO}\n{text}"


def write_flyable(folder: Path, scenario: dict[str, Any], configuration: Configuration) -> Path:
    """Write scenario and library into a folder that exists; return the scenario's path.

    Raises:
        OSError: they can't be written.
    """
    path = folder / SCENARIO
    path.write_text(scenario_text(scenario), encoding="utf-8", newline="\n")
    if not is_built_in(configuration):
        (folder / LIBRARY).mkdir(exist_ok=True)
        for name, text in library_texts(configuration).items():
            (folder / LIBRARY / name).write_text(text, encoding="utf-8", newline="\n")
    return path


def _values(value: Any) -> Any:
    """Return a record as its data file has it: lists, no name, nothing that is None."""
    if dataclasses.is_dataclass(value):
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return {k: _values(v) for k, v in fields.items() if k != "name" and v is not None}
    return [_values(item) for item in value] if isinstance(value, tuple) else value
