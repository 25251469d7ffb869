"""Cores for tests: a call for each message, which says what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tombo_collision.detector import DetectorMemory, begin_detector, detect, set_triggers
from tombo_collision.params import DetectorParams
from tombo_control.controller_core import ControllerCore
from tombo_control.estimator_core import EstimatorCore
from tombo_control.mission_core import MissionCore
from tombo_control.safety.state_machine import NO_ROW, SafetyState
from tombo_dynamics.core import Core
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.messages import (
    EstimatorStatus,
    Imu,
    MissionStatus,
    Odometry,
    Phase,
    Pose,
    PositionSetpoint,
    ReactionStatus,
    Trigger,
    neutral,
)
from tombo_dynamics.records import parameter_record
from tombo_dynamics.vehicle import GRAVITY

Array = NDArray[np.float64]
_ZERO = np.zeros(3)
_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
_REST = np.array([0.0, 0.0, GRAVITY])


def reported(core: Core, topic: str, message: Any, now_ns: int) -> list[str]:
    """Hand a message to a core; return the keys of its reports."""
    core.health.take_events()
    core.on(topic, message, now_ns)
    return [key for key, _ in core.health.take_events()]


@dataclass(frozen=True)
class StampedEstimate:
    """State of the vehicle at the capture of a gyro sample; map, base_link, SI, xyzw."""

    stamp_ns: int
    position: Array
    velocity: Array
    attitude: Array
    rates: Array
    gyro_bias: Array
    accel_bias: Array
    pose_stamp_ns: int


class Estimator(EstimatorCore):
    """The estimator's core."""

    def pose(
        self, stamp_ns: int, now_ns: int, frame_id: str, position: Array, attitude: Array
    ) -> PoseRefusal:
        """Hand over a pose; return why it is not used."""
        pose = Pose(stamp_ns, frame_id, position, attitude)
        keys = reported(self, "/mocap/pose", pose, now_ns)
        return next((why for why in PoseRefusal if f"pose_{why.key}" in keys), PoseRefusal.NONE)

    def imu(self, stamp_ns: int, gyro: Array, accel: Array) -> StampedEstimate | None:
        """Hand over an IMU sample; return the estimate, None without a new one."""
        before = int(self.memory.next_tick)
        self.on("/imu/data_raw", Imu(stamp_ns, gyro, accel), stamp_ns)
        return None if self.memory.next_tick == before else self.estimate

    def phase(self, phase: int) -> None:
        self.on("/mission/status", MissionStatus(0, phase, ""), 0)

    @property
    def estimate(self) -> StampedEstimate | None:
        """The newest one."""
        memory = self.memory
        if not memory.known:
            return None
        e = memory.estimate.copy()
        stamps = int(memory.stamp_ns), int(memory.pose_stamp_ns)
        return StampedEstimate(
            stamps[0], e.position, e.velocity, e.attitude, e.rates, e.gyro_bias, e.accel_bias,
            stamps[1],
        )  # fmt: skip


class Command(NamedTuple):
    """Answer to one gyro sample."""

    stamp_ns: int
    speed: Array
    """(4) rotor speeds [rad/s]."""
    position_ran: bool
    attitude_ran: bool
    blind: bool
    """Levels and descends: the position is not known."""
    setpoint_late: bool
    """Holds the last set point: none is coming."""


class Controller(ControllerCore):
    """The controller's core. Calls return whether it has taken what they hand over."""

    def estimate(self, odometry: Odometry) -> bool:
        return not reported(self, "/odometry", odometry, odometry.stamp_ns)

    def biases(self, gyro_bias: Array, pose_stamp_ns: int, accel_bias: Array = _ZERO) -> bool:
        status = EstimatorStatus(0, True, gyro_bias, accel_bias, pose_stamp_ns, 0, 0)
        return not reported(self, "/estimator/status", status, pose_stamp_ns)

    def setpoint(self, setpoint: PositionSetpoint, now_ns: int) -> bool:
        return not reported(self, "/setpoint", setpoint, now_ns)

    def tick(
        self, now_ns: int, stamp_ns: int, gyro: Array, accel: Array = _REST
    ) -> Command | None:
        """Hand over a gyro sample; return the answer, None where there is none."""
        self.on("/imu/data_raw", Imu(stamp_ns, gyro, accel), now_ns)
        published = dict(self.step(now_ns))
        if "/rotor_command" not in published:
            return None
        memory, speed = self.memory, published["/rotor_command"].speed
        ran = "/attitude_setpoint" in published, "/rates_setpoint" in published
        return Command(
            stamp_ns, speed, *ran, "blind" in self.health.faults, bool(memory.setpoint_late)
        )


def begin_in_flight(core: ControllerCore) -> None:
    """Put a controller in command of a vehicle that flies already."""
    watch: Any = core.memory.watch
    watch.state, watch.row, watch.has_commanded = SafetyState.FLY, NO_ROW, True


def take_over(core: ControllerCore) -> None:
    """Have a controller obey its next set point of a flight, as if it had seen the take-off."""

    def take(topic: str, message: Any, now_ns: int) -> Any:
        taken = type(core).take(core, topic, message, now_ns)
        if topic == "/setpoint" and taken and message.phase not in (Phase.IDLE, Phase.LANDED):
            del core.take  # type: ignore[method-assign]
            begin_in_flight(core)
        return taken

    core.take = take  # type: ignore[method-assign]


class Mission(MissionCore):
    """The mission's core."""

    def estimate(self, position: Array, velocity: Array, now_ns: int) -> bool:
        """Hand over an estimate, level; return whether it is taken."""
        odometry = Odometry(now_ns, position, _LEVEL, velocity, _ZERO)
        return not reported(self, "/odometry", odometry, now_ns)

    def reaction(
        self, state: int, x_r: Array, collisions: int, stamp_ns: int, now_ns: int
    ) -> None:
        status = ReactionStatus(stamp_ns, state, _ZERO, x_r, _ZERO, collisions)
        self.on("/reaction/status", status, now_ns)

    def reaction_alive(self, now_ns: int) -> None:
        self.on("/setpoint", neutral(PositionSetpoint, now_ns), now_ns)


class DetectedCollision(NamedTuple):
    """A collision that the detector has seen, in seconds."""

    stamp_s: float
    trigger: str
    contact_time_s: float
    x_c: Array
    flight_direction: Array
    confidence: float
    statistic: float
    count: int


class CollisionDetector:
    """Watches capture-stamped poses; `update` returns an event when one is detected."""

    def __init__(self, params: DetectorParams) -> None:
        self.memory = DetectorMemory.new()
        begin_detector(self.memory)
        self.refused = PoseRefusal.NONE
        """Why the last sample was not used."""
        self.set_params(params)

    def set_params(self, params: DetectorParams) -> None:
        """Go on with other parameters; earlier samples stay."""
        self._params = parameter_record(params)
        set_triggers(self.memory, params)

    @property
    def statistic(self) -> float:
        """Normalised innovation squared of the last sample; 0 where there was none."""
        return float(self.memory.statistic)

    def update(self, stamp_s: float, position: Array, attitude: Array) -> DetectedCollision | None:
        """Take a pose as `detect` does; return an event if it shows a collision."""
        memory = self.memory
        self.refused = detect(memory, self._params, stamp_s, position, attitude)
        if not memory.collided:
            return None
        return DetectedCollision(
            stamp_s,
            Trigger(memory.trigger).name.lower(),
            float(memory.contact_s),
            memory.x_c.copy(),
            memory.direction.copy(),
            float(memory.confidence),
            self.statistic,
            int(memory.count),
        )
