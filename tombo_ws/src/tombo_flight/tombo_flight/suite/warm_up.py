"""Goes through the cores of all nodes once, so that the nodes find their code compiled.

Otherwise the first start after a change would compile in three processes at once, in flight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tombo_collision.detector_core import DetectorCore
from tombo_control.autopilot import HOVER
from tombo_control.controller_core import ControllerCore
from tombo_control.estimate import Setpoint
from tombo_control.estimator_core import EstimatorCore
from tombo_control.params import InputLimits
from tombo_flight.scenario import Scenario, world_of
from tombo_sim.failsafe import Failsafe
from tombo_sim.simulator import Simulator

Array = NDArray[np.float64]

_TICKS = 250
_TICK_NS = 1_000_000
_BEGIN_NS = 1_000_000_000


def warm_up_nodes(scenario: Scenario) -> int:
    """Fly a quarter of a second, all nodes' cores in one loop; return the commands given.

    Raises:
        InputError: as `Simulator`.
    """
    vehicle = scenario.vehicle
    simulator = Simulator(world_of(scenario), 0)
    failsafe = Failsafe(simulator, vehicle)
    observer = EstimatorCore(scenario.estimator, vehicle)
    limits = InputLimits()
    controller = ControllerCore(scenario.control, vehicle, limits, simulator.setup.maps)
    watch = DetectorCore(scenario.detector)
    wish = Setpoint(simulator.setup.start, np.zeros(3), np.zeros(3), 0.0, HOVER)
    speed: Array = np.zeros(4)
    commands = 0
    for tick in range(_TICKS):
        now = _BEGIN_NS + tick * _TICK_NS
        gyro, force = simulator.imu[:3].copy(), simulator.imu[3:].copy()
        for sample in simulator.arrived:
            stamp = _BEGIN_NS + sample.stamp_ns
            observer.pose(stamp, now, "map", sample.pose[:3], sample.pose[3:])
            watch.pose(stamp, now, "map", sample.pose[:3], sample.pose[3:])
        estimate = observer.imu(now, gyro, force)
        if estimate is not None:
            controller.estimate(estimate)
            controller.biases(estimate.gyro_bias, estimate.pose_stamp_ns)
        controller.setpoint(wish, now)
        answer = controller.tick(now, now, gyro)
        if answer is not None:
            speed, commands = answer.speed, commands + 1
        simulator.advance(speed)
        failsafe.observe(simulator)
    failsafe.engage(simulator.tick)
    failsafe.observe(simulator)
    return commands
