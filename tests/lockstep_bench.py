"""Simulator, observer and flight controller in one process, a tick at a time, as the nodes run.

Attributes switch on faults of the wire between them (loss, delay).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_calls import Command, Controller, Estimator, StampedEstimate, take_over
from tombo_control.params import POSITION_TICKS, InputLimits
from tombo_control.planning import mission as plan
from tombo_control.planning.leg import leg_reference
from tombo_control.planning.mission_memory import MissionMemory
from tombo_dynamics.messages import Odometry, Phase, PositionSetpoint
from tombo_dynamics.records import numbers
from tombo_dynamics.rotation import rotate_vector, tilt
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_flight.scenario import Scenario, load_scenario, world_of
from tombo_sim.simulator import Simulator

Array = NDArray[np.float64]


def calm(*settings: str) -> Scenario:
    """The paper's vehicle without a pillar."""
    return load_scenario("no_obstacle", settings)


def hover_at(x: float, y: float, z: float, velocity: Any = (0.0, 0.0, 0.0)) -> PositionSetpoint:
    return PositionSetpoint(
        0, np.array([x, y, z]), np.array(velocity), np.zeros(3), 0.0, Phase.HOVER
    )


def odometry_of(estimate: StampedEstimate) -> Odometry:
    """Return an estimate as the estimator publishes it: velocity in base_link."""
    x, y, z, w = estimate.attitude
    velocity = rotate_vector(np.array([-x, -y, -z, w]), estimate.velocity)
    return Odometry(
        estimate.stamp_ns, estimate.position, estimate.attitude, velocity, estimate.rates
    )


class Lockstep:
    """One flight. `step` is a millisecond."""

    def __init__(self, scenario: Scenario, seed: int = 1) -> None:
        self.scenario = scenario
        self.simulator = Simulator(world_of(scenario), seed)
        self.observer = Estimator(scenario.estimator, scenario.vehicle)
        self.controller = Controller(
            scenario.control, scenario.vehicle, InputLimits(), self.simulator.setup.maps
        )
        self.mission = MissionMemory.new()
        plan.begin(self.mission, self.simulator.setup.start)
        self.steer: Callable[[float], PositionSetpoint | None] | None = None
        """Set point at a time [s] in place of the mission's; None: none is sent."""
        self.odometry_ticks = 1
        self.late_ticks = 0
        self.loss = 0.0
        """Share of IMU samples lost, for observer and controller each."""
        self.mocap_on = self.odometry_on = self.imu_on = True
        self.shift_ns = 0
        """Added to all stamps and to the time, as a clock that was set does."""
        self.command: Command | None = None
        self._speed = np.zeros(4)
        self._chance = np.random.default_rng(seed)
        self._under_way: deque[tuple[int, StampedEstimate]] = deque()

    @property
    def now_ns(self) -> int:
        return EPOCH_NS + self.simulator.tick * TICK_NS + self.shift_ns

    @property
    def position(self) -> Array:
        """True."""
        return self.simulator.plant.state.position.copy()

    @property
    def velocity(self) -> Array:
        return self.simulator.plant.state.velocity.copy()

    @property
    def tilt(self) -> float:
        return float(tilt(self.simulator.plant.state.attitude))

    def step(self) -> None:
        simulator, now = self.simulator, self.now_ns
        tick = simulator.tick
        imu = simulator.imu.copy()
        posed = False
        for sample in simulator.arrived if self.mocap_on else []:
            stamp = EPOCH_NS + sample.captured * TICK_NS + self.shift_ns
            self.observer.pose(stamp, now, "map", sample.pose[:3], sample.pose[3:])
            posed = True
        if self.imu_on and not self._lost():
            estimate = self.observer.imu(now, imu[:3], imu[3:])
            if estimate is not None and tick % self.odometry_ticks == 0 and self.odometry_on:
                self._under_way.append((tick + self.late_ticks, estimate))
        while self._under_way and self._under_way[0][0] <= tick:
            estimate = self._under_way.popleft()[1]
            self.controller.estimate(odometry_of(estimate))
            biases = estimate.gyro_bias, estimate.pose_stamp_ns, estimate.accel_bias
            self.controller.biases(*biases)
        if tick % POSITION_TICKS == 0:
            self._send_setpoint(tick * 1e-3, now)
        if self.imu_on and not self._lost():
            self.command = self.controller.tick(now, now, imu[:3], imu[3:])
            if self.command is not None:
                self._speed = self.command.speed
        simulator.advance(self._speed)
        if posed and self.observer.estimate is not None:
            self._proceed(self.observer.estimate)

    def fly(self, seconds: float) -> Array:
        """Go on; return position, velocity, attitude, rates (13) of each tick."""
        rows = []
        for _ in range(round(seconds * 1000)):
            self.step()
            rows.append(numbers(self.simulator.plant.state))
        return np.array(rows)

    def _lost(self) -> bool:
        return self.loss > 0.0 and bool(self._chance.random() < self.loss)

    def _send_setpoint(self, time_s: float, now_ns: int) -> None:
        setpoint = self._setpoint(time_s) if self.steer is None else self.steer(time_s)
        if setpoint is not None:
            self.controller.setpoint(setpoint, now_ns)
            self.observer.phase(setpoint.phase)

    def _setpoint(self, time_s: float) -> PositionSetpoint:
        *reference, yaw = leg_reference(self.mission.leg, time_s)
        return PositionSetpoint(0, *map(np.array, reference), yaw, self.mission.mode)

    def _proceed(self, estimate: StampedEstimate) -> None:
        plan.advance_mission(
            self.mission,
            plan.compiled_plan(self.scenario.mission),
            self.simulator.tick * 1e-3,
            estimate.position,
            estimate.velocity,
        )


def hovering(scenario: Scenario | None = None, height: float = 2.0, seed: int = 1) -> Lockstep:
    """A flight that has been brought to a hover above the origin."""
    flight = Lockstep(scenario or calm(), seed)
    flight.steer = lambda _: None
    flight.fly(0.2)
    take_over(flight.controller)
    flight.steer = lambda _: hover_at(0.0, 0.0, height)
    flight.fly(1.5 * height + 3.0)
    assert abs(flight.position[2] - height) < 0.2
    return flight
