"""A scenario as the ROS parameters of the suite's nodes: `--params-file` takes the text.

`python -m tombo_flight.suite.parameter_yaml` writes that of the default scenario,
`config/suite.yaml`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from tombo_dynamics.params import as_text
from tombo_flight.scenario import Scenario, as_mapping, load_scenario
from tombo_flight.several_vehicles import vehicles_of
from tombo_flight.wiring import NEW_TOPICS, records_of
from tombo_sim.propeller_effects import vehicle_effects
from tombo_sim.wiring import CORES

SECTIONS: Final[dict[str, tuple[str, ...]]] = {
    "sim": ("vehicle", "propeller", "obstacle", "spread", "effects"),
    **{core.name: tuple(core.sections) for core in CORES},
    "recorder": (),
}
"""Node → the sections that it has as parameters."""

BRIDGE_SECTIONS: Final = ("vehicle", "volume", "safety")
"""Parameters of the bridge, which replaces estimator and controller over PX4."""

_WHOLE = ("safety", "volume", "spread")
"""Sections that a scenario's mapping leaves defaults out of."""
_ANYWHERE = "/**/"
"""Pattern of nodes in every namespace, and in none."""
_PARAMETERS = "ros__parameters"

Parameters = dict[str, dict[str, Any]]
"""Node → its parameters, nested."""


def suite_parameters(
    scenario: Scenario, seed: int, *, speed: float = 1.0, lockstep: bool = False
) -> Parameters:
    """Return the parameters of every node of the suite.

    Args:
        scenario: what to fly; effects that follow from its propeller are filled in.
        seed: of the simulator's random draws.
        speed: of simulated time against real time; other than 1, `sim` drives `/clock`.
        lockstep: all nodes run the ticks of the headless flight, as fast as they can.
    """
    values = as_mapping(scenario)
    values["mission"]["course"] = as_text(values["mission"]["course"])
    if "curve" in values["propeller"]:
        values["propeller"]["curve"] = as_text(values["propeller"]["curve"])
    values |= {section: asdict(getattr(scenario, section)) for section in _WHOLE}
    values["effects"] = vehicle_effects(scenario.propeller, scenario.vehicle, scenario.effects)
    table: Parameters = {
        "sim": {section: values[section] for section in SECTIONS["sim"]},
        **{
            core.name: {
                section: values[section] if section in values else asdict(record)
                for section, record in records_of(core, scenario).items()
            }
            for core in CORES
        },
        "recorder": {},
    }
    if NEW_TOPICS:
        named = [f"{spec.name} {spec.typename}" for spec in NEW_TOPICS.values()]
        table["recorder"]["new_topics"] = named
    table["sim"] |= {"seed": seed, "mocap_rate": scenario.estimator.mocap_rate}
    policy = table["reaction"]["policy"]
    table["reaction"] |= {
        "reaction": scenario.reaction.name,
        "policy": policy | {"network": as_text(policy["network"])},
    }
    if speed != 1.0 or lockstep:
        for parameters in table.values():
            parameters["use_sim_time"] = True
        table["sim"]["speed"] = float(speed)
    if lockstep:
        for parameters in table.values():
            parameters["lockstep"] = True
        table["sim"]["duration"] = scenario.duration
        table["sim"]["lockstep_nodes"] = [name for name in table if name != "sim"]
    return table


def several_parameters(
    scenario: Scenario, seed: int, vehicles: int, *, lockstep: bool = False
) -> Parameters:
    """Return the parameters of every node of several vehicles, by their full names.

    In lockstep the recorder takes no part: nobody waits for it.
    """
    flown = vehicles_of(scenario, vehicles, seed)
    table: Parameters = {"recorder": {"namespaces": [vehicle.name for vehicle in flown]}}
    for vehicle in flown:
        own = suite_parameters(vehicle.scenario, vehicle.seed, lockstep=lockstep)
        if lockstep:
            own["sim"]["lockstep_nodes"].remove("recorder")
        own["sim"] |= {f"start_{axis}": at for axis, at in zip("xy", vehicle.start, strict=True)}
        others = [f"/{other.name}/mocap/pose" for other in flown if other is not vehicle]
        own["mission"]["others"] = " ".join(others)
        table["recorder"] |= own.pop("recorder")
        table |= {f"/{vehicle.name}/{node}": values for node, values in own.items()}
    return table


def bridge_parameters(scenario: Scenario) -> dict[str, Any]:
    """Return the parameters of the PX4 bridge from a scenario."""
    return {section: asdict(getattr(scenario, section)) for section in BRIDGE_SECTIONS}


def parameter_yaml(parameters: Mapping[str, Mapping[str, Any]], comment: str = "") -> str:
    """Return the text of a parameter file.

    Numbers keep their type, which ROS insists on: 1.0 is not written as 1. Texts are quoted.

    Args:
        parameters: node → parameter → value, nested; a name with a slash is of one namespace.
        comment: is at the top, line by line.
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    for node, values in parameters.items():
        if not values:
            continue
        name = node if node.startswith("/") else f"{_ANYWHERE}{node}"
        lines += [f"{name}:", f"  {_PARAMETERS}:"]
        lines += _lines(values, "    ")
    return "\n".join(lines) + "\n"


def _lines(values: Mapping[str, Any], indent: str) -> list[str]:
    found = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            inner = _lines(value, indent + "  ")
            found += [f"{indent}{name}:", *inner] if inner else []
        else:
            found.append(f"{indent}{name}: {_word(value)}")
    return found


def _word(value: Any) -> str:
    """Return a value as YAML 1.1 and ROS's own reader both understand it."""
    if isinstance(value, float):
        mantissa, e, exponent = repr(value).partition("e")
        return f"{mantissa}{'' if '.' in mantissa or not e else '.0'}{e}{exponent}"
    return json.dumps(value, ensure_ascii=False)


def default_file() -> str:
    """Return the content of `config/suite.yaml`."""
    scenario = load_scenario()
    comment = (
        f"ROS parameters of all nodes for the scenario {scenario.name}. Generated:\n"
        "python -m tombo_flight.suite.parameter_yaml. What each means, with unit and bounds,\n"
        "is in all_parameters.yaml, and in `ros2 param describe`."
    )
    return parameter_yaml(suite_parameters(scenario, 0), comment)


if __name__ == "__main__":
    sys.stdout.write(default_file())
