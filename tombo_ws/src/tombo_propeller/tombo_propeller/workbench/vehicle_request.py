"""The vehicle that a propeller is for, and the propeller's flight into the pillar."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from tombo_bag.flight import Flight
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number
from tombo_dynamics.propeller import Blade, Library
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario
from tombo_propeller.design.candidates import measured_soft
from tombo_propeller.design.design import strike_share
from tombo_propeller.design.flight_files import (
    library_texts,
    scenario_of,
    scenario_text,
    write_flyable,
)
from tombo_propeller.design.operating_points import flight_performance
from tombo_propeller.design.readings import read
from tombo_propeller.design.request import QUANTITIES, DesignRequest, arm_of, vehicle_for
from tombo_propeller.workbench.curves import bench_force
from tombo_propeller.workbench.propeller_choice import PAPER, ChosenPropeller

LIMITS: Final = tuple(q.limit for q in QUANTITIES)
_KEYS: Final = ("mass_kg", "arm_mm", "law", "extrapolate", *LIMITS)
_HOVER_SPEED: Final = 512.0
"""rad/s: the paper's vehicle hovers at it, and is flown with the force of 2000 rpm."""
STRONGEST_N: Final = {p.name: p for p in REGISTRY["blade_strike"].theta}["peak_force"].bounds[1]
"""Highest force of a strike that the simulator takes."""
_SEEDS: Final = (0, 10_000)


def design_request(values: Mapping[str, Any], blade: Blade) -> DesignRequest:
    """Return the request of a vehicle as the page sends it.

    Args:
        values: mass_kg, arm_mm, law, extrapolate and LIMITS; missing values have their defaults.
        blade: the arms have to keep its discs apart.

    Raises:
        InputError: names the key, the value and the accepted ones.
    """
    for key in values:
        if key not in _KEYS:
            raise unknown_name("key of a vehicle", key, _KEYS)
    given = {key: values[key] for key in LIMITS if values.get(key) is not None}
    law, extrapolate = values.get("law", "repaired"), values.get("extrapolate", False)
    if not isinstance(law, str) or not isinstance(extrapolate, bool):
        raise InputError(
            f"law {shown(law)}, extrapolate {shown(extrapolate)}; accepted: a name, true or false"
        )
    size = blade.tip_radius_m / 0.1111
    mass = values.get("mass_kg", round(1.3 * size**2, 2))
    arm = values.get("arm_mm", round(240.0 * size))
    check_number("arm_mm", arm, "mm", (1.0, 1000.0))
    arm_m = arm_of(f"{arm:g}", blade)
    return DesignRequest(mass_kg=mass, arm_m=arm_m, law=law, extrapolate=extrapolate, **given)


def flyable(choice: ChosenPropeller, request: DesignRequest, library: Library) -> dict[str, Any]:
    """Return the paper's collision as a scenario with a propeller on a vehicle.

    A force that was measured is flown as it was, a predicted one at its upper end. Another blade
    than the paper's strikes as its own spin momentum in hover says, STRONGEST_N at most.

    Raises:
        InputError: a rigid propeller, or one that can't lift the vehicle.
    """
    chosen = choice.configuration
    if chosen.nodus is None:
        raise InputError("soft: false; accepted: a propeller with a nodus")
    vehicle = vehicle_for(request, choice.blade)
    performance = flight_performance([chosen], vehicle, request.law)
    hover = float(performance.hover_speed[0])
    if not hover > 0.0:
        most = float(performance.usable_thrust[0])
        raise InputError(
            f"mass_kg {request.mass_kg:g}: the propeller gives {most:.2f} N at most; accepted: "
            f"less than {4.0 * most / 9.81:.2f} kg"
        )
    value, _, high, _ = bench_force(choice, library)
    force = value if chosen.measured is not None else high
    if not choice.on_paper_blade:
        force *= strike_share(choice.blade, library.blades[PAPER]) * hover / _HOVER_SPEED
    recovery = chosen.measured.recovery_s if chosen.measured is not None else None
    if recovery is None:
        model = read("recovery_s", measured_soft(library, library.blades[PAPER]))
        recovery = model.mean + model.reach(request.confidence)
    return scenario_of(request, chosen, min(force, STRONGEST_N), recovery)


def flyable_files(
    choice: ChosenPropeller, request: DesignRequest, library: Library
) -> dict[str, str]:
    """Return file name → text of what `tombo fly` and `--library` take.

    Raises:
        InputError: as `flyable`.
    """
    scenario = flyable(choice, request, library)
    texts = library_texts(choice.configuration)
    return {
        "design.yaml": scenario_text(scenario),
        **{f"library/{name}": text for name, text in texts.items()},
    }


def fly(
    choice: ChosenPropeller, request: DesignRequest, library: Library, seed: Any = 0
) -> Flight:
    """Fly a propeller into the pillar.

    Raises:
        InputError: as `flyable`, or the simulator refuses the vehicle.
    """
    number = int(check_number("seed", seed, "1", _SEEDS, integer=True))
    scenario = flyable(choice, request, library)
    with tempfile.TemporaryDirectory(prefix="tombo-workbench-") as folder:
        path = write_flyable(Path(folder), scenario, choice.configuration)
        return fly_scenario(load_scenario(str(path)), number)
