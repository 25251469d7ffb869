"""What to tell the user of a real PX4: how to start it so that it fits the Tombo vehicle."""

from __future__ import annotations

from collections.abc import Mapping

from tombo_dynamics.vehicle import SPIN
from tombo_px4.bridge.vehicle_parameters import SAFE_PARAMETERS
from tombo_px4.frames import PX4_ROTORS, frd_from_flu
from tombo_px4.hil.flight import HilFlight
from tombo_px4.hil.link import PX4_PORT
from tombo_sim.world import World

AIRFRAME = {"PX4_SIM_MODEL": "none_iris", "PX4_SYS_AUTOSTART": "10016"}
_IMAGE = "px4io/px4-sitl:v1.18.0-rc1"
"""PX4's containers begin with 1.18."""
_MOST_INSTANCES = 255


def airframe_parameters(world: World, flight: HilFlight) -> dict[str, float]:
    """Return the PX4 parameters that describe the Tombo vehicle.

    PX4's iris has its front rotors farther out than the rear ones: untold, yawing would roll.
    """
    parameters = {"MPC_THR_HOVER": round(flight.controls.hover, 3), **SAFE_PARAMETERS}
    positions = frd_from_flu(world.vehicle.rotor_positions())
    ratio = float(flight.simulator.setup.maps.torque_ratio)
    for motor, rotor in enumerate(PX4_ROTORS):
        name = f"CA_ROTOR{motor}_"
        parameters[name + "PX"] = round(float(positions[rotor, 0]), 3)
        parameters[name + "PY"] = round(float(positions[rotor, 1]), 3)
        parameters[name + "KM"] = round(ratio * float(SPIN[rotor]), 3)
    return parameters


def exported(parameters: Mapping[str, float], more: Mapping[str, str] | None = None) -> str:
    """Return the shell command that puts parameters of PX4, and `more`, into its environment."""
    settings = [f"{name}={value}" for name, value in (more or {}).items()]
    settings += [f"PX4_PARAM_{name}={value:g}" for name, value in parameters.items()]
    lines = [" ".join(settings[i : i + 3]) for i in range(0, len(settings), 3)]
    return "export " + " \\\n  ".join(lines)


def start_commands(port: int, parameters: Mapping[str, float]) -> tuple[str, str, str]:
    """Return shell commands: what PX4 finds in its environment, then two ways to start it.

    The first starts one built from its sources, the second one in its container. PX4 takes
    PX4_PARAM_... at its start, and keeps them.
    """
    number = port - PX4_PORT
    instance = f" -i {number}" if 0 < number < _MOST_INSTANCES else ""
    variables = "$(env | grep -o '^PX4_[A-Z0-9_]*' | sed 's/^/-e /')"
    return (
        exported(parameters, AIRFRAME),
        f"./build/px4_sitl_default/bin/px4{instance}",
        f"docker run --rm -it --network host {variables} {_IMAGE}{instance}",
    )
