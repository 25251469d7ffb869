"""Records of the bridge and its session: requests, states, outputs, and commands under way.

A command (mode, arm, disarm) is sent, confirmed by HEARTBEAT, repeated, given up.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.pose_axes import AxesEvidence
from tombo_px4.link import decoded_messages as decoded
from tombo_px4.link import message_encoder
from tombo_px4.link.decoded_messages import (
    CommandAck,
    Heartbeat,
    MavLandedState,
    Result,
    Severity,
    StatusText,
)
from tombo_px4.link.message_encoder import MessageTarget
from tombo_px4.modes import Mode, mode_name

CONFIRM_NS = 2 * SECOND_NS
"""Longest wait for the heartbeat (1 Hz) that confirms a command."""
PAUSE_NS = SECOND_NS
"""Pause between a refusal and the next attempt; PX4 sends its explanation meanwhile."""


@dataclass(frozen=True)
class VehicleCommand:
    """A mode, or armed or not: one of the two is set."""

    mode: Mode | None = None
    armed: bool | None = None
    force: bool = False
    """Disarms in the air, too."""

    @property
    def command(self) -> int:
        """Number of the MAVLink command."""
        by_mode = self.mode is not None
        return int(mav.MAV_CMD_DO_SET_MODE if by_mode else mav.MAV_CMD_COMPONENT_ARM_DISARM)

    def message(self, target: MessageTarget) -> Any:
        """Return it as a MAVLink message."""
        if self.mode is not None:
            return message_encoder.set_mode(target, self.mode)
        return message_encoder.arm(target, bool(self.armed), self.force)

    def confirmed_by(self, heartbeat: Heartbeat) -> bool:
        """Return whether the heartbeat shows the commanded state."""
        if self.mode is not None:
            return heartbeat.mode == self.mode
        return heartbeat.armed == self.armed

    def __str__(self) -> str:
        if self.mode is not None:
            return f"mode {mode_name(self.mode)}"
        return "arming" if self.armed else "disarming" + (" by force" if self.force else "")


class SessionStage(Enum):
    """State of the session with the vehicle."""

    WAITING = "waiting for the vehicle"
    READY = "ready"
    ENTERING_OFFBOARD = "entering offboard"
    ARMING = "arming"
    FLYING = "offboard"
    LANDING = "landing"
    EXTERNAL_MODE = "mode set by another station"
    GIVEN_UP = "given up"
    LINK_LOST = "link lost"


class SetpointSource(Enum):
    """Which set point is sent."""

    PRESENT = "present"
    """The position that PX4 reports."""
    HOLD = "hold"
    """Where it was when this began."""
    SETPOINT = "setpoint"
    LEVEL_DESCENT = "level descent"
    """Attitude and thrust, by gyro and accelerometer: where the poses are wrong."""
    NONE = "none"
    """Nothing is sent: PX4 must not return to OFFBOARD."""


@dataclass(frozen=True)
class OperatorRequest:
    """A request of an operator."""

    number: int
    kind: str
    """`arm`, `disarm`, `offboard`, `takeoff`, `land`, `hold` or `kill`."""


@dataclass(frozen=True)
class Reply:
    """The answer to a request, once it is known."""

    number: int
    success: bool
    text: str


@dataclass(frozen=True)
class SessionInput:
    """Inputs of one tick."""

    now_ns: int
    heartbeat: Heartbeat | None
    """The last one; None: none ever came."""
    landed: MavLandedState
    phase: int
    """Of the mission; IDLE without one."""
    fresh: bool
    """A set point came lately."""
    streaming: bool
    """There is a position to stream."""
    blockers: tuple[str, ...]
    """Why arming is not allowed, as texts."""
    must_land: str = ""
    """Why the flight must end now, as a text."""
    takeoff_commands: int = 0
    """How often an operator has asked the mission to take off."""
    poses_wrong: bool = False
    """The poses are not those of this vehicle: PX4's own landing would fly away by them."""
    touched: bool = False
    """In a descent by thrust: the ground carries the vehicle."""

    @property
    def beat(self) -> Heartbeat:
        """The last heartbeat, where there is one."""
        assert self.heartbeat is not None
        return self.heartbeat


@dataclass(frozen=True)
class BridgeStatus:
    """State of vehicle and bridge; published at each change."""

    connected: bool = False
    armed: bool = False
    mode: str = ""
    landed: MavLandedState = MavLandedState.UNDEFINED
    stage: SessionStage = SessionStage.WAITING
    why: str = ""
    offboard: bool = False
    ready: bool = False
    findings: tuple[str, ...] = ()
    text: str = ""
    firmware: str = ""


@dataclass
class BridgeOutput:
    """Outputs of one tick: of the session, and of the bridge around it."""

    stream: SetpointSource = SetpointSource.PRESENT
    vehicle_commands: list[VehicleCommand] = field(default_factory=list)
    faults: dict[str, str] = field(default_factory=dict)
    """Key -> what is wrong, for as long as it is."""
    events: list[tuple[str, str]] = field(default_factory=list)
    """Key and text of what went wrong just now."""
    replies: list[Reply] = field(default_factory=list)
    messages: list[Any] = field(default_factory=list)
    """To be sent now."""
    odometry: list[decoded.VehicleOdometry] = field(default_factory=list)
    """All with a stamp."""
    imu: list[decoded.VehicleImu] = field(default_factory=list)
    battery: list[decoded.BatteryReading] = field(default_factory=list)
    texts: list[decoded.StatusText] = field(default_factory=list)
    status: BridgeStatus = field(default_factory=BridgeStatus)
    evidence: AxesEvidence | None = None
    """What was shown just now of the poses' axes: to be kept."""


class RecentStatusTexts:
    """The last warnings of PX4, to explain a refusal."""

    def __init__(self) -> None:
        self._texts: deque[StatusText] = deque(maxlen=8)

    def take(self, text: StatusText) -> None:
        """Keep a text if it is a warning or worse."""
        if text.severity <= Severity.WARNING:
            self._texts.append(text)

    def since(self, time_ns: int) -> str:
        """Return the texts since a time, each once."""
        texts = dict.fromkeys(t.text for t in self._texts if t.arrival_ns >= time_ns)
        return ", ".join(f"'{text}'" for text in texts)


class CommandTransaction:
    """A command in progress. `tick` tells when to send it; `done` or `failed` ends it."""

    def __init__(self, order: VehicleCommand, tries: int) -> None:
        self.order = order
        self.done = False
        self.failed = False
        self.refusal = ""
        """Why PX4 refused it the last time, or did not answer."""
        self._tries = tries
        self._begun_ns = 0
        self._sent_ns: int | None = None
        self._refused_ns: int | None = None
        self._result = int(Result.ACCEPTED)

    def handle_ack(self, ack: CommandAck) -> None:
        """Take an answer. A refusal is final for this attempt; only HEARTBEAT confirms."""
        if ack.command != self.order.command or self._sent_ns is None or self.done:
            return
        if ack.result not in (Result.ACCEPTED, Result.IN_PROGRESS) and self._refused_ns is None:
            self._refused_ns, self._result = ack.arrival_ns, ack.result

    def tick(self, heartbeat: Heartbeat, recent_texts: RecentStatusTexts, now_ns: int) -> bool:
        """Advance; return whether the command is to be sent now."""
        if self._sent_ns is None:  # even if it looks met: the last heartbeat may be a second old
            return self._send(now_ns)
        if self.order.confirmed_by(heartbeat) and heartbeat.arrival_ns > self._begun_ns:
            self.done = True
            return False
        if self._refused_ns is not None:
            if now_ns - self._refused_ns < PAUSE_NS:
                return False
            why = _result_name(self._result)
        elif now_ns - self._sent_ns < CONFIRM_NS:
            return False
        else:
            why = f"not confirmed by HEARTBEAT within {CONFIRM_NS * 1e-9:.0f} s"
        texts = recent_texts.since(self._sent_ns)
        self.refusal = f"{self.order} {why}" + (f": {texts}" if texts else "")
        if self._tries <= 0:
            self.failed = True
            return False
        return self._send(now_ns)

    def _send(self, now_ns: int) -> bool:
        self._tries -= 1
        self._begun_ns = self._begun_ns or now_ns
        self._sent_ns, self._refused_ns = now_ns, None
        return True


def _result_name(result: int) -> str:
    if result in range(Result.CANCELLED + 1):
        return Result(result).name.lower().replace("_", " ")
    return f"result {result}"
