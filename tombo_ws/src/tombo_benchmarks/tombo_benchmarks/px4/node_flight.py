"""One flight with a real PX4 over the ROS 2 nodes, in real time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tombo_benchmarks.px4.lockstep_flight import contacts
from tombo_benchmarks.px4.lockstep_px4 import ONBOARD_PORT, Px4Setup
from tombo_benchmarks.px4.px4_process import Px4Process
from tombo_flight.process.output_folder import OutputFolder
from tombo_flight.process.stop_signals import StopSignals
from tombo_flight.progress import no_progress
from tombo_flight.run_wiring import warm_up_nodes
from tombo_flight.scenario import Scenario, world_of
from tombo_flight.suite.node_flight import NotFlown, fly_nodes_and_save
from tombo_flight.suite.px4_connection import px4_connection
from tombo_px4.bridge.bridge_params import SIMULATED
from tombo_px4.bridge.vehicle_parameters import MOCAP_ONLY
from tombo_px4.hil.flight import PX4_PORT, airframe_parameters


def fly_nodes_with(
    setup: Px4Setup, output: OutputFolder, scenario: Scenario, stop: StopSignals
) -> dict[str, Any]:
    """Fly a scenario once over the nodes; return its summary, with `armed` and `why_not`.

    Args:
        setup: a real PX4.
        output: for the files of the flight.
        scenario: what to fly.
        stop: a request to stop ends the flight.

    Raises:
        InputError: PX4, simulator or recorder does not run.
    """
    assert setup.build is not None
    warm_up_nodes(scenario)
    world = world_of(scenario)
    parameters = airframe_parameters(world, 0)
    parameters |= MOCAP_ONLY
    settings = [f"link.system={setup.instance + 1}"]
    px4 = px4_connection(f"udpin://127.0.0.1:{ONBOARD_PORT + setup.instance}", settings)
    # vehicle and motion capture are the simulator that this command starts
    bridge = replace(px4.bridge, axes_evidence=SIMULATED)
    px4 = replace(px4, hil_port=PX4_PORT + setup.instance, bridge=bridge)
    try:
        with Px4Process(setup.build, setup.folder, parameters, setup.instance):
            flight, _ = fly_nodes_and_save(
                output, scenario, setup.seed, stop, speed=1.0, domain=None,
                on_progress=no_progress, px4=px4,
            )  # fmt: skip
    except NotFlown as error:
        return {"armed": False, "why_not": str(error), "crashed": False, "seed": setup.seed}
    more = {"contacts": contacts(flight.log["contact"][:, 0])}
    return {**flight.summary, **more, "armed": True, "why_not": ""}
