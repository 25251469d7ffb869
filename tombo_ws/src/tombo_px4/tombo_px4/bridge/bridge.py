"""The bridge to PX4 without sockets and without ROS: messages in, messages out, time given.

Poses of the motion capture go to PX4's estimator, set points to its cascade; its estimate and its
sensors come back. Preflight checks and the session decide whether and when it is armed.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import is_map
from tombo_dynamics.input_check import PoseRefusal, check_pose
from tombo_dynamics.messages import Phase, PositionSetpoint
from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.axes_proof import AxesEvidence
from tombo_px4.bridge.bridge_params import BridgeParams, LinkParams
from tombo_px4.bridge.checklist import Checklist, Finding
from tombo_px4.bridge.flight_watch import FlightWatch, RepeatedPose
from tombo_px4.bridge.level_descent import LevelDescent
from tombo_px4.bridge.link_health import MessageRates
from tombo_px4.bridge.session import (
    BridgeOutput,
    BridgeStatus,
    Session,
    SessionInput,
    SessionStage,
    SetpointSource,
    VehicleCommand,
)
from tombo_px4.bridge.setpoint_stream import FlightLimits, SetpointStream
from tombo_px4.bridge.vehicle_parameters import HOVER, READ, ParameterReader
from tombo_px4.link import messages
from tombo_px4.link.mavlink_link import Received
from tombo_px4.link.messages import (
    CommandAck,
    Heartbeat,
    MessageDecoder,
    MessageTarget,
    StatusText,
    VehicleImu,
    VehicleOdometry,
)
from tombo_px4.link.timesync import TimeSync, answer_request
from tombo_px4.modes import AUTO_LAND, OFFBOARD, MavLandedState, Result, mode_name

_HEARTBEAT_NS = SECOND_NS
"""Period of our heartbeats, as MAVLink asks."""
_REBOOT_NS = SECOND_NS
"""PX4 was restarted if its time since boot goes back by more; less is a late message."""
_TIMESYNC_NS = SECOND_NS // 10
"""Period of our TIMESYNC requests."""
_CHECK_NS = SECOND_NS // 5
"""Period of the checks."""
_ASK_NS = 3 * SECOND_NS
"""Period of new requests for messages that come too seldom."""
_SETTLE_NS = 4 * SECOND_NS
"""Time of a new link in which the checks fail for want of messages: no faults are reported."""
_READY_NS = 3 * SECOND_NS
"""Time for which the checks pass before the estimate is published: PX4's estimator settles for
some seconds after its first position."""
_LINK_TIMEOUT_S = 2.5
"""Time without a heartbeat after which the link is lost: PX4 sends 1 Hz, and one may miss."""
_POSE_JUMP_M = 0.5
"""A pose further from PX4's own position in flight is not sent: five EKF2_EVP_NOISE (0.1 m), PX4's
gate; a second later it would follow it."""
_HEARTBEAT_REQUEST_NS = SECOND_NS // 4
"""A heartbeat older than this is asked for while something is to be confirmed, and in flight: PX4
sends one a second and refuses another interval, so that an order would be confirmed late."""
_SET_BACK_NS = SECOND_NS // 2
"""A clock that jumps by more between two ticks was set."""
_TURNING = 0.3
"""Rate of a vehicle that a hand turns [rad/s]."""
_LONGEST_STEP_S = 0.05
"""Longest time over which an IMU sample is integrated [s]: after a gap it is not known."""
_THRUST_S = 0.1
"""Period of ATTITUDE_TARGET, as PX4 sends it [s]."""


class Bridge:
    """The bridge. All times [ns] are of the clock that stamps poses and arrivals."""

    def __init__(
        self,
        params: BridgeParams,
        link: LinkParams,
        mass: float,
        writes: dict[str, float] | None = None,
        *,
        proofs: Sequence[AxesEvidence] = (),
        limits: FlightLimits | None = None,
    ) -> None:
        """Make the bridge.

        Args:
            params: messages to send, and conditions of a pose.
            link: ids; the link itself is the caller's.
            mass: of the vehicle [kg], for thrusts.
            writes: parameters of the vehicle that are to be set.
            proofs: of the axes of the tracked body, the oldest first; those of this vehicle count.
            limits: of place, speed and tilt; None: none.
        """
        self.params = params
        self.sync = TimeSync()
        self.answered = 0
        """TIMESYNC requests of the vehicle that were answered."""
        self.message_decoder = MessageDecoder(self.sync, link.own_system, link.own_component)
        self.checklist = Checklist(params, proofs)
        self.limits = limits or FlightLimits()
        self.watch = FlightWatch(params, self.limits, self.checklist)
        self.descent = LevelDescent(mass, self.limits.safety)
        self._repeated = RepeatedPose()
        self.session = Session(_LINK_TIMEOUT_S)
        self.poses_sent = 0
        self.poses_refused: Counter[str] = Counter()
        self.findings: list[Finding] = []
        self.status = BridgeStatus()
        self.estimate_trusted = False
        """PX4's estimate may be relied on: the checks have passed, or it flies."""
        self._ready_ns: int | None = None
        self._target = MessageTarget(link.system, link.component)
        self.message_rates = MessageRates(params, self._target)
        self.stream = SetpointStream(params, self._target, self.limits)
        self.parameters = ParameterReader(READ, self._target, writes)
        self._out = BridgeOutput()
        self._asked: list[tuple[int, int]] = []
        """Times in TIMESYNC requests of the vehicle, and their arrivals."""
        self._heartbeat: Heartbeat | None = None
        self._odometry: VehicleOdometry | None = None
        self._imu: VehicleImu | None = None
        self._landed = MavLandedState.UNDEFINED
        self._version = ""
        self._last_text = ""
        self._boot_ns = 0
        self._linked_ns: int | None = None
        """Since when the present link has been there; None: no link."""
        self.pose_stamp_ns = 0
        """Capture of the last pose that was sent."""
        self._now_ns = 0
        self._done_ns: dict[str, int] = {}
        """When what is done again and again was done last."""

    # --- What comes in ------------------------------------------------------------------------

    def take(self, received: Received) -> None:
        """Handle a message of the vehicle."""
        name = received.message.get_type()
        self.message_rates.count(name, received.arrival_ns)
        content: Any = self.message_decoder.read(received)
        if content is not None and name in self._handlers:
            self._handlers[name](content)

    @cached_property
    def _handlers(self) -> dict[str, Callable[[Any], object]]:
        """Name of a message → what takes its content."""
        return {
            "ODOMETRY": self._take_odometry,
            "HIGHRES_IMU": self._take_imu,
            "HEARTBEAT": partial(setattr, self, "_heartbeat"),
            "TIMESYNC": self._take_timesync,
            "COMMAND_ACK": self._take_ack,
            "STATUSTEXT": self._say,
            "EXTENDED_SYS_STATE": partial(setattr, self, "_landed"),
            "ESTIMATOR_STATUS": partial(setattr, self.checklist, "estimator"),
            "PARAM_VALUE": self.parameters.take,
            "BATTERY_STATUS": lambda message: self._out.battery.append(message),
            "ATTITUDE_TARGET": self._take_throttle,
            "AUTOPILOT_VERSION": self._take_version,
        }

    def _take_version(self, content: tuple[str, str]) -> None:
        self._version, hardware_id = content
        self.checklist.take_vehicle(hardware_id)

    def _take_imu(self, message: VehicleImu) -> None:
        self.checklist.take_imu(message, self._odometry, self._flying)
        before, self._imu = self._imu, message
        if message.stamp_ns is None:
            return
        self._out.imu.append(message)
        if self._flying or float(np.linalg.norm(message.gyro)) > _TURNING:
            self._repeated.moves()
        if before is not None:
            step_s = min((message.boot_ns - before.boot_ns) * 1e-9, _LONGEST_STEP_S)
            self.descent.feel(message.gyro, message.accel, step_s)

    def _take_throttle(self, throttle: float) -> None:
        """Learn the throttle that hovers, of a vehicle in the air."""
        if self._imu is not None and self._flying:
            self.descent.learn_hover(throttle, float(self._imu.accel[2]), _THRUST_S)

    def _take_timesync(self, content: tuple[int, int, int]) -> None:
        arrival_ns, tc1, ts1 = content
        if tc1 == 0:
            self._asked.append((ts1, arrival_ns))
        else:
            self.sync.reply(tc1, ts1, arrival_ns)

    def _take_ack(self, ack: CommandAck) -> None:
        """Take an answer; ask for all failed checks where arming is refused.

        PX4 reports a check when its result changes, which may be long ago.
        """
        self.session.handle_ack(ack)
        arms = ack.command == mav.MAV_CMD_COMPONENT_ARM_DISARM and not self._armed
        if arms and ack.result not in (Result.ACCEPTED, Result.IN_PROGRESS):
            self._out.messages.append(
                messages.command(self._target, mav.MAV_CMD_RUN_PREARM_CHECKS)
            )

    def _say(self, text: StatusText) -> None:
        self._last_text = text.text
        self.session.recent_texts.take(text)
        self._out.texts.append(text)

    def _take_odometry(self, message: VehicleOdometry) -> None:
        if message.boot_ns < self._boot_ns - _REBOOT_NS:
            self._rebooted(message.arrival_ns)
        elif message.boot_ns <= self._boot_ns:
            return
        self._boot_ns = message.boot_ns
        self._odometry = message
        self.checklist.take_odometry(message)
        if message.stamp_ns is not None:
            self._out.odometry.append(message)

    def _rebooted(self, now_ns: int) -> None:
        """Begin the link anew after a restart of PX4, noticed at `now_ns`.

        A restarted PX4 has lost its message rates: all are requested again at the next tick.
        Faults are reported again once `_SETTLE_NS` have passed since `_linked_ns`.
        """
        self._out.events.append(("vehicle_rebooted", "PX4 was restarted: its clock went back"))
        self.checklist.reset()
        self.parameters.reset()
        self._done_ns.pop("ask", None)
        self._linked_ns = now_ns

    def pose(
        self, stamp_ns: int, now_ns: int, frame_id: str, position: Array, attitude: Array
    ) -> PoseRefusal:
        """Take a pose of the motion capture; it leaves at the next tick.

        Args:
            stamp_ns: time of capture.
            now_ns: its arrival, of the same clock.
            frame_id: must be `map`.
            position: (3) of base_link [m].
            attitude: (4) xyzw, map from base_link; its length may be off by a tenth.

        Returns:
            Why it is not sent.
        """
        age_s, length = (now_ns - stamp_ns) * 1e-9, np.linalg.norm(attitude)
        why = self._refuse_pose(stamp_ns, now_ns, frame_id, position, attitude)
        if why:
            self.poses_refused[why.key] += 1
            self.checklist.refused_pose(why, now_ns, age_s)
            if why == PoseRefusal.DISTRUSTED:  # its motion shows the direction to brake by
                self.checklist.poses.add(
                    stamp_ns, now_ns, position, attitude / np.linalg.norm(attitude)
                )
            return why
        self.pose_stamp_ns, self.watch.pose_ns = stamp_ns, now_ns
        unit = attitude / length
        self.checklist.poses.add(stamp_ns, now_ns, position, unit)
        pose = messages.pose_message(stamp_ns, position, unit)
        self._out.messages.append(pose)
        self.poses_sent += 1
        return why

    def _refuse_pose(
        self, stamp_ns: int, now_ns: int, frame_id: str, position: Array, attitude: Array
    ) -> PoseRefusal:
        if not is_map(frame_id):
            return PoseRefusal.WRONG_FRAME
        oldest_ns = self.params.pose_age_max * SECOND_NS
        why = check_pose(stamp_ns, now_ns, oldest_ns, position, attitude)
        if not why and self.pose_stamp_ns - SECOND_NS < stamp_ns <= self.pose_stamp_ns:
            return PoseRefusal.OUT_OF_ORDER
        if not why and self.watch.distrusts:
            return PoseRefusal.DISTRUSTED
        if not why and self._repeated.repeats(now_ns, position, attitude):
            return PoseRefusal.REPEATED
        if not why and self._jumps(stamp_ns, now_ns, position):
            self.watch.jump_ns = self.watch.jump_ns or now_ns
            return PoseRefusal.JUMP
        self.watch.jump_ns = None
        return why

    def _jumps(self, stamp_ns: int, now_ns: int, position: Array) -> bool:
        """Return whether a pose in flight is elsewhere than PX4, which would follow it."""
        last = self._odometry
        if not self._flying or last is None or last.stamp_ns is None:
            return False
        if now_ns - last.arrival_ns > _CHECK_NS:
            return False
        expected = last.position + 1e-9 * (stamp_ns - last.stamp_ns) * last.velocity
        return math.dist(expected, position) > _POSE_JUMP_M

    @property
    def _armed(self) -> bool:
        return self._heartbeat is not None and self._heartbeat.armed

    @property
    def _flying(self) -> bool:
        return self._armed and self._landed != MavLandedState.ON_GROUND

    # --- What goes out ------------------------------------------------------------------------

    def tick(self, now_ns: int) -> BridgeOutput:
        """Decide; return the messages to send and to publish."""
        out, self._out = self._out, BridgeOutput()
        self._follow_clock(now_ns, out)
        self._answer_timesync(now_ns, out)
        linked = self._follow_link(now_ns)
        if self._due("check", _CHECK_NS, now_ns):
            self.findings = self._check(now_ns)
        self._watch_motion(now_ns, out)
        self.session.tick(self._view(now_ns), out)
        out.messages += [order.message(self._target) for order in out.vehicle_commands]
        self._housekeeping(now_ns, linked, out)
        out.messages += self._setpoint_messages(out.stream, now_ns)
        if linked:
            self._report_faults(now_ns, out)
        self.status = out.status = self._status(linked)
        self._update_estimate_trusted(now_ns)
        return out

    def _view(self, now_ns: int) -> SessionInput:
        """Return the inputs of the session's decision."""
        return SessionInput(
            now_ns,
            self._heartbeat,
            self._landed,
            self.stream.phase,
            self.stream.fresh(now_ns),
            self._present(now_ns) is not None,
            tuple(f.text for f in self._blocking),
            self._must_land(now_ns),
            self.stream.takeoff_commands,
            self.watch.mistake is not None,
            self.descent.touched,
        )

    def _setpoint_messages(self, stream: SetpointSource, now_ns: int) -> list[Any]:
        """Return the set point to send now, if one is due."""
        odometry = self._odometry
        if stream == SetpointSource.LEVEL_DESCENT and odometry is not None:
            velocity = self.checklist.motion.velocity
            hover = float(self.parameters.values.get(HOVER, 0.0))  # 0: not known
            wanted = self.descent.step(now_ns, odometry.attitude, velocity, hover)
            if wanted is None:
                return []
            return [messages.attitude_target(*wanted, self._target, now_ns)]
        self.descent.end()
        self.stream.ceiling = self.watch.ceiling(now_ns)
        message = self.stream.message(stream, self._present(now_ns), now_ns)
        return [] if message is None else [message]

    @property
    def _blocking(self) -> list[Finding]:
        return [f for f in self.findings if f.check.blocks]

    def _must_land(self, now_ns: int) -> str:
        """Return why the flight must end, "" if it may go on."""
        silent_s = self.stream.silent_s(now_ns)
        if self.session.stage == SessionStage.FLYING and silent_s > self.limits.safety.hold_time:
            return f"no set point for {silent_s:.0f} s"
        if not self._flying:
            self.watch.rest()
            return ""
        return self.watch.must_land(now_ns, self._odometry, self.findings)

    def _watch_motion(self, now_ns: int, out: BridgeOutput) -> None:
        """Compare the motion of the poses since the arming with that of PX4's sensors."""
        follows = self.session.stage == SessionStage.FLYING
        takes_off = follows and self.stream.phase == Phase.TAKEOFF
        latest = self.checklist.latest_position
        beside_m = 0.0 if latest is None else self.stream.horizontal_distance(latest)
        mistake = self.watch.follow(now_ns, self._armed, takes_off, beside_m)
        if mistake is not None:
            key = "axes_wrong" if mistake.check.voids_proof else "poses_wrong"
            out.events.append((key, mistake.text))
            if mistake.check.voids_proof:
                self.checklist.refute(mistake.text, now_ns)
        out.evidence = self.checklist.take_evidence()

    def _update_estimate_trusted(self, now_ns: int) -> None:
        self._ready_ns = (self._ready_ns or now_ns) if self.status.ready else None
        settled = self._ready_ns is not None and now_ns - self._ready_ns >= _READY_NS
        self.estimate_trusted = self.estimate_trusted or self.status.armed or settled

    def _follow_clock(self, now_ns: int, out: BridgeOutput) -> None:
        """Take a clock that was set; where it was set back, forget all times of the past."""
        before_ns, self._now_ns = self._now_ns, now_ns
        if now_ns > before_ns + _SET_BACK_NS:
            self.watch.pose_ns += now_ns - before_ns  # nobody looked, or the clock was set ahead
        if now_ns >= before_ns - _SET_BACK_NS:
            return
        back = (before_ns - now_ns) * 1e-9
        text = f"the system's clock was set back by {back:.1f} s: all stamps begin again"
        out.events.append(("clock_set_back", text))
        self._done_ns.clear()
        self.pose_stamp_ns = 0
        self.stream.clock_set_back(now_ns)
        self._ready_ns = self.watch.jump_ns = None
        self.watch.rest()
        self.watch.pose_ns = now_ns
        self._linked_ns = now_ns if self._linked_ns is not None else None
        if self._heartbeat is not None:
            self._heartbeat = self._heartbeat._replace(arrival_ns=now_ns)
        self._odometry = None
        self.checklist.reset()
        self.parameters.reset()
        self.message_rates.clear()
        self.session.clock_set_back(out)

    def _follow_link(self, now_ns: int) -> bool:
        """Return whether the vehicle is there."""
        beat = self._heartbeat
        if beat is None or now_ns - beat.arrival_ns > _LINK_TIMEOUT_S * SECOND_NS:
            self._linked_ns = None
            return False
        if self._linked_ns is None:
            self._linked_ns = now_ns
            self._done_ns.clear()
            self.message_rates.clear()
        return True

    def _due(self, what: str, period_ns: int, now_ns: int) -> bool:
        """Return whether what is done every period is to be done now."""
        due = now_ns - self._done_ns.get(what, 0) >= period_ns
        if due:
            self._done_ns[what] = now_ns
        return due

    def _answer_timesync(self, now_ns: int, out: BridgeOutput) -> None:
        for ts1, arrival_ns in self._asked:
            self.answered += 1
            times = answer_request(ts1, arrival_ns, now_ns)
            out.messages.append(mav.MAVLink_timesync_message(*times))
        self._asked.clear()

    def _housekeeping(self, now_ns: int, linked: bool, out: BridgeOutput) -> None:
        if self._due("heartbeat", _HEARTBEAT_NS, now_ns):
            out.messages.append(messages.heartbeat())
        beat = self._heartbeat
        if not linked or beat is None:
            return
        if self._due("timesync", _TIMESYNC_NS, now_ns):
            out.messages.append(mav.MAVLink_timesync_message(*self.sync.request(now_ns)))
        begun = "ask" not in self._done_ns
        if self._due("ask", _ASK_NS, now_ns):
            out.messages += self.message_rates.requests(now_ns, begun)
            if not self._version:
                out.messages.append(self._request(mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION))
        waits = beat.armed or self.session.awaits_confirmation
        old = now_ns - beat.arrival_ns >= _HEARTBEAT_REQUEST_NS
        if waits and old and self._due("heartbeat request", _HEARTBEAT_REQUEST_NS, now_ns):
            out.messages.append(self._request(mav.MAVLINK_MSG_ID_HEARTBEAT))
        out.messages += self.parameters.tick(now_ns, not beat.armed)

    def _request(self, number: int) -> Any:
        return messages.request_message(self._target, number)

    def shutdown_command(self) -> Any:
        """Return the command that lands a vehicle that flies by our set points; None: not needed.

        For a bridge that is told to end: send it, and again until this is None.
        """
        beat, stage = self._heartbeat, self.session.stage
        ours = (SessionStage.ENTERING_OFFBOARD, SessionStage.ARMING, SessionStage.FLYING)
        if beat is None or stage not in ours:
            return None
        # arming may be under way
        disarms = stage == SessionStage.ARMING if not beat.armed else not self._flying
        if disarms:
            return VehicleCommand(armed=False).message(self._target)
        lands = beat.armed and beat.mode == OFFBOARD
        return VehicleCommand(mode=AUTO_LAND).message(self._target) if lands else None

    # --- Set points ---------------------------------------------------------------------------

    def _present(self, now_ns: int) -> PositionSetpoint | None:
        """Return the vehicle's own position as a set point; None if it is not known."""
        odometry = self._odometry
        if odometry is None or now_ns - odometry.arrival_ns > SECOND_NS:
            return None
        zero = np.zeros(3)
        yaw = float(yaw_pitch_roll(odometry.attitude)[0])
        return PositionSetpoint(now_ns, odometry.position, zero, zero, yaw, Phase.IDLE)

    # --- What is wrong ------------------------------------------------------------------------

    def _check(self, now_ns: int) -> list[Finding]:
        if self._linked_ns is None:
            return []
        return self.checklist.findings(
            now_ns,
            self.sync,
            self.parameters.values,
            linked_ns=self._linked_ns,
            answered=self.answered,
            flying=self._flying,
            unwritten=self.parameters.unwritten,
        )

    def _report_faults(self, now_ns: int, out: BridgeOutput) -> None:
        """Add the faults of a link that seems to work."""
        settled = now_ns - (self._linked_ns or now_ns) > _SETTLE_NS
        flies = self.session.stage in (SessionStage.FLYING, SessionStage.LANDING)
        for finding in self.findings if settled or flies else ():
            out.faults[f"check.{finding.check.key}"] = finding.text
        if self.session.stage == SessionStage.FLYING:
            out.faults.update(self.stream.faults(now_ns))
        if settled:
            out.faults.update(self.message_rates.faults(now_ns))
        if self.parameters.complete and not self.parameters.values:
            text = "PX4 sends no parameters: they can't be checked"
            out.faults["parameters_unknown"] = text
        if self.parameters.await_restart:
            names = ", ".join(self.parameters.await_restart)
            out.faults["parameters_at_start"] = f"{names} changed: restart PX4, it uses them then"

    def _status(self, linked: bool) -> BridgeStatus:
        beat = self._heartbeat
        return BridgeStatus(
            linked,
            self._armed,
            "" if beat is None else mode_name(beat.mode),
            self._landed,
            self.session.stage,
            self.session.why,
            self.session.stage == SessionStage.FLYING and self.stream.follows_suite,
            linked and not self._blocking,
            tuple(f.text for f in self.findings),
            self._last_text,
            self._version,
        )

    def metrics(self, now_ns: int) -> dict[str, Any]:
        """Return the values on `/diagnostics`, without the faults."""
        sync, last, status = self.sync, self._odometry, self.status
        metrics: dict[str, Any] = {
            "mode": status.mode,
            "armed": status.armed,
            "landed": status.landed.name.lower(),
            "stage": status.stage.value,
            "timesync_offset_ns": sync.offset_ns,
            "timesync_round_trip_us": None if sync.rtt_ns is None else round(sync.rtt_ns * 1e-3),
            "mocap_rate_hz": self.checklist.pose_rate_hz(now_ns),
            "mocap_latency_ms": round(1e3 * self.checklist.latency_s(now_ns), 2),
            "poses_sent": self.poses_sent,
            "setpoints_sent": self.stream.sent,
            "odometry_latency_ms": None
            if last is None or last.stamp_ns is None
            else round((last.arrival_ns - last.stamp_ns) * 1e-6, 2),
            "findings": " | ".join(
                f"{'blocks' if f.check.blocks else 'warning'}: {f.text}" for f in self.findings
            ),
        }
        for prefix, values in (
            ("poses_refused", self.poses_refused),
            ("refused", self.message_decoder.refused),
            ("rate_hz", self.message_rates.rates(now_ns)),
            ("parameter", self.parameters.values),
        ):
            metrics |= {f"{prefix}.{name}": value for name, value in values.items()}
        return metrics
