"""The node that connects PX4 over MAVLink in place of estimator and controller.

Poses of the motion capture and set points go out, odometry, IMU and battery come in; services arm
and change modes, and answer when PX4's heartbeat says that it is so.
"""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from tombo_bag.message_codec import MessageCodec
from tombo_bag.topics import BATTERY, IMU, MOCAP_POSE, ODOMETRY, PX4_STATUS, SETPOINT, TF
from tombo_control.safety.flight_volume import check_volume
from tombo_control.safety.params import FlightVolume, SafetyParams
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_BODY, FRAME_MAP
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.messages import Imu, Odometry, PositionSetpoint, unknown_covariance
from tombo_dynamics.rotation import conjugate, rotate_vector
from tombo_dynamics.time_base import SECOND_NS
from tombo_dynamics.vehicle import VehicleParams
from tombo_msgs.msg import Px4Status
from tombo_px4.bridge.axes_proof import AxesEvidence, AxesFile
from tombo_px4.bridge.bridge import Bridge
from tombo_px4.bridge.bridge_params import BridgeParams, LinkParams
from tombo_px4.bridge.link_health import link_faults
from tombo_px4.bridge.session import BridgeOutput, BridgeStatus, SessionStage
from tombo_px4.bridge.setpoint_stream import FlightLimits
from tombo_px4.bridge.vehicle_parameters import parse_assignments
from tombo_px4.link.mavlink_link import read_key
from tombo_px4.link.messages import BatteryReading, VehicleImu, VehicleOdometry
from tombo_px4.link.vehicle_link import open_link
from tombo_px4.modes import OFFBOARD, MavLandedState, Severity, mode_name
from tombo_ros.conversion import array, to_ns, to_time
from tombo_ros.core_node import main_of
from tombo_ros.health import ERROR, WARN
from tombo_ros.node_loop import LoopNode
from tombo_ros.pacing import ESTIMATOR
from tombo_ros.topic import message_class
from tombo_ros.transforms import TransformPublisher

_RATE_HZ = 250.0
_TF_NS = 20_000_000
_STATUS_REPEAT_NS = SECOND_NS
"""Shortest time between two reports of a finding whose numbers change."""
_LANDING_NS = 20 * SECOND_NS
"""Longest wait for a vehicle that lands, unless it gets a second signal."""
_LANDING_STEP_S = 0.004
_ASK_AGAIN_NS = SECOND_NS
_FLUSH_S = 0.1
"""Time for the last messages to be sent."""
_ERROR_FAULTS = ("no_vehicle", "link_lost", "mode_taken", "given_up", "wrong_system")
_NUMBER = re.compile(r"[-+]?\d[\d.]*")


class Px4BridgeNode(LoopNode):
    """Runs `Bridge` and owns the link; only the loop's thread touches either."""

    def __init__(self) -> None:
        """Declare parameters, topics and services; open the link."""
        records = {
            "link": LinkParams(),
            "px4": BridgeParams(),
            "vehicle": VehicleParams(),
            "volume": FlightVolume(),
            "safety": SafetyParams(),
        }
        super().__init__("px4_bridge", _RATE_HZ, records, fixed=records, priority=ESTIMATOR)
        try:
            self._set_up()
        except InputError:
            self.destroy()  # now: the rest of a node complains at the end of the program
            raise

    def _set_up(self) -> None:
        self._stops = 0
        self._status = BridgeStatus()
        writes = self.declare(
            "px4_parameters",
            [],
            "NAME=VALUE of vehicle parameters to be set while it is disarmed; empty: none is",
        )
        if self.sim_time:
            raise InputError("use_sim_time: true; accepted: false, PX4 flies in real time")
        link = self.records["link"]
        key = read_key(link.key_file, partial(self.health.fault, "key_file", True))
        mass = self.records["vehicle"].mass
        params = self.records["px4"]
        check_volume(self.records["volume"])
        self._proofs = AxesFile(params.axes_evidence)
        self._bridge = Bridge(
            params,
            link,
            mass,
            parse_assignments(writes),
            proofs=self._proofs.of_body(params.tracked_body),
            limits=FlightLimits(self.records["volume"], self.records["safety"]),
        )
        self._link = open_link(link, key, time.time_ns)
        rotate_vector(np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))  # loads its compiled code now
        self._pose_in = self.subscribe(MOCAP_POSE, depth=20)
        self._pose_came_ns: int | None = None
        """Capture of the newest pose, whether or not it can be used."""
        self._setpoint_in = self.subscribe(SETPOINT)
        self._setpoint_codec = MessageCodec(SETPOINT.typename)
        self._odometry_out, self._imu_out = self.advertise(ODOMETRY), self.advertise(IMU)
        self._battery_out, self._status_out = self.advertise(BATTERY), self.advertise(PX4_STATUS)
        self._seldom_ns = 0
        """Stamp of the last estimate that went out as a transform, too."""
        self._transforms = TransformPublisher(self.advertise(TF))
        self._waiting: deque[tuple[str, Any]] = deque()  # filled by the services' thread
        self._pending_requests: dict[int, Any] = {}
        self._offer(SetBool, "arm", lambda request: "arm" if request.data else "disarm")
        for kind in ("takeoff", "land", "hold", "offboard", "kill"):
            self._offer(Trigger, kind, lambda request, kind=kind: kind)
        self._offer(Trigger, "abort", lambda request: "land")
        self._active: set[str] = set()
        self._published: tuple[BridgeStatus, ...] = ()
        self._published_ns = 0

    # --- Services: called in their own thread, answered by the loop --------------------------

    def _offer(self, service: Any, name: str, kind_of: Callable[[Any], str]) -> None:
        """Pass requests to the loop; it answers within some seconds, other calls go on."""

        async def call(request: Any, response: Any) -> Any:
            future: Any = Future()
            self._waiting.append((kind_of(request), future))
            response.success, response.message = await future
            return response

        self.ros.create_service(service, f"px4/{name}", call)

    # --- The loop -----------------------------------------------------------------------------

    def step(self, now_ns: int) -> None:
        """Handle the messages of both sides, decide, send, publish."""
        bridge = self._bridge
        for received in self._link.receive():
            bridge.take(received)
        now_ns = time.time_ns()
        self._take_poses(now_ns)
        self._take_setpoints(now_ns)
        while self._waiting:
            kind, future = self._waiting.popleft()
            self._pending_requests[bridge.session.request(kind)] = future
        bridge_output = bridge.tick(time.time_ns())
        for message in bridge_output.messages:
            self._link.send(message)
        if bridge.estimate_trusted:  # the mission begins with the first estimate
            for odometry in bridge_output.odometry:
                self._publish_odometry(odometry)
        for sample in bridge_output.imu:
            self._publish_imu(sample)
        for battery in bridge_output.battery:
            self._battery_out.publish(_battery(battery))
        if bridge_output.evidence is not None:
            self._keep(bridge_output.evidence)
        for reply in bridge_output.replies:
            self._pending_requests.pop(reply.number).set_result((reply.success, reply.text))
            self._executor.wake()
        self._status = bridge_output.status
        self._report(bridge_output, now_ns)

    def _keep(self, evidence: AxesEvidence) -> None:
        """Add what was shown of the axes to the file, and say so."""
        logger, shown = self.ros.get_logger(), evidence.mistake or "the axes are right"
        try:
            place = self._proofs.add(evidence)
        except InputError as error:
            self.health.fault("axes_file", True, str(error), WARN)
            return
        logger.info(f"axes of the poses: {shown}{place}")

    def _take_poses(self, now_ns: int) -> None:
        multiple_publishers = self._pose_in.multiple_publishers(now_ns)
        if multiple_publishers:
            self._bridge.checklist.refused_pose(PoseRefusal.TWO_PUBLISHERS, now_ns)
        for arrival in self._pose_in.take():
            if multiple_publishers:
                continue
            message = arrival.message
            self._pose_came_ns = to_ns(message.header.stamp)
            why = self._bridge.pose(
                self._pose_came_ns,
                arrival.received_ns,
                message.header.frame_id,
                array(message.pose.position),
                array(message.pose.orientation),
            )
            if why:
                self.health.report_event(f"pose_{why.key}", why.text)

    def _take_setpoints(self, now_ns: int) -> None:
        multiple_publishers = self._setpoint_in.multiple_publishers(now_ns)
        for arrival in self._setpoint_in.take_raw():
            text = ""
            try:
                setpoint: PositionSetpoint = self._setpoint_codec.decode(arrival.message)
                if not multiple_publishers and not self._bridge.stream.setpoint(setpoint, now_ns):
                    text = "set point with NaN or infinity: the last one stands"
            except InputError as error:
                text = f"set point: {error}: the last one stands"
            if text:
                self.health.report_event("setpoint_refused", text)

    def _report(self, bridge_output: BridgeOutput, now_ns: int) -> None:
        """Log texts, keep the faults, publish the status."""
        logger = self.ros.get_logger()
        for text in bridge_output.texts:
            said = f"PX4: {text.text}"
            if text.severity <= Severity.ERROR:  # rclpy: one severity for each line of code
                logger.error(said)
            elif text.severity == Severity.WARNING:
                logger.warning(said)
            else:
                logger.info(said)
        for key, text in bridge_output.events:
            self.health.report_event(key, text)
        for text in bridge_output.texts[:-1]:  # a status carries one text
            self._publish_status(replace(bridge_output.status, text=text.text), now_ns)
        connected = bridge_output.status.connected
        faults = bridge_output.faults | link_faults(self._link, self.records["link"], connected)
        for key in self._active - faults.keys():
            self.health.fault(key, False)
        for key, text in faults.items():
            self.health.fault(key, True, text, ERROR if key in _ERROR_FAULTS else WARN)
        self._active = set(faults)
        self._publish_status(bridge_output.status, now_ns)

    # --- What is published --------------------------------------------------------------------

    def _publish_odometry(self, odometry: VehicleOdometry) -> None:
        assert odometry.stamp_ns is not None
        stamp_ns, attitude = odometry.stamp_ns, odometry.attitude
        covariance = odometry.pose_covariance
        known = unknown_covariance() if covariance is None else covariance.ravel()
        moving = rotate_vector(conjugate(attitude), odometry.velocity)
        content = (stamp_ns, odometry.position, attitude, moving, odometry.rates, known)
        self._odometry_out.send(Odometry(*content))
        if stamp_ns - self._seldom_ns < _TF_NS:
            return
        self._seldom_ns = stamp_ns
        self._transforms.send(stamp_ns, odometry.position, attitude)

    def _publish_imu(self, sample: VehicleImu) -> None:
        assert sample.stamp_ns is not None
        self._imu_out.send(Imu(sample.stamp_ns, sample.gyro, sample.accel))

    def _publish_status(self, status: BridgeStatus, now_ns: int) -> None:
        """Publish a status that is new; where only numbers have changed, once a second."""
        findings = tuple(_NUMBER.sub("#", text) for text in status.findings)
        current = (replace(status, why="", findings=findings), status)
        recent = now_ns - self._published_ns < _STATUS_REPEAT_NS
        if self._published[1:] == current[1:] or (recent and self._published[:1] == current[:1]):
            return
        self._published, self._published_ns = current, now_ns
        message: Any = Px4Status()
        message.header.stamp, message.header.frame_id = to_time(now_ns), FRAME_MAP
        for name in ("connected", "armed", "mode", "why", "offboard", "ready", "firmware"):
            setattr(message, name, getattr(status, name))
        message.landed_state, message.stage = int(status.landed), status.stage.value
        message.findings, message.status_text = list(status.findings), status.text
        self._status_out.publish(message)

    def report(self, now_ns: int) -> None:
        """Add the state of link and vehicle."""
        for key, value in self._bridge.metrics(time.time_ns()).items():
            self.health.value(key, value)
        for key, count in self._link.counters.items():
            if count:
                self.health.value(f"link.{key}", count)
        self.health.value("link.url", self._link.url)
        if self._pose_came_ns is not None:
            self.health.value(
                "mocap_age_s", round((time.time_ns() - self._pose_came_ns) * 1e-9, 3)
            )
        super().report(now_ns)

    def stop(self) -> None:
        """End the loop; a second call also ends the wait for the landing."""
        self._stops += 1
        super().stop()

    def close(self) -> None:
        """Bring down a vehicle that flies by our set points, and close the link."""
        if self._status.connected and (self._status.armed or self._bridge.shutdown_command()):
            self._come_down()
        last = self._bridge.shutdown_command()
        if last is not None:
            self._link.send(last)
            time.sleep(_FLUSH_S)
        self._link.close()

    def _come_down(self) -> None:
        """Land or disarm what follows our set points; poses go on until it is disarmed."""
        self.ros.get_logger().warning(
            f"ending in flight, mode {self._status.mode}: poses go on until the vehicle is "
            f"disarmed, {_LANDING_NS // 10**9} s at most, or until told again to end"
        )
        before, asked_ns = self._stops, 0
        end_ns = time.monotonic_ns() + _LANDING_NS
        while self._status.connected and self._stops == before and time.monotonic_ns() < end_ns:
            status = self._status
            arming = not status.armed and self._bridge.shutdown_command() is not None
            if not (status.armed or arming):
                break
            # any mode but OFFBOARD was chosen by another station and is kept
            flies = status.mode == mode_name(OFFBOARD) and status.stage != SessionStage.LANDING
            waited = time.monotonic_ns() - asked_ns > _ASK_AGAIN_NS and not self._pending_requests
            if waited and (arming or flies):
                asked_ns = time.monotonic_ns()
                grounded = arming or status.landed == MavLandedState.ON_GROUND
                number = self._bridge.session.request("disarm" if grounded else "land")
                self._pending_requests[number] = Future()
            self._link.wait(_LANDING_STEP_S)
            wall_ns = time.time_ns()
            self.step(wall_ns)
            self.periodic_tasks(wall_ns, wall_ns)


def _battery(battery: BatteryReading) -> Any:
    message: Any = message_class(BATTERY.typename)()
    message.header.stamp, message.header.frame_id = to_time(battery.arrival_ns), FRAME_BODY
    message.voltage, message.percentage = battery.voltage, battery.remaining
    message.current = -battery.current  # discharging is negative in ROS
    nan = float("nan")
    message.charge = message.capacity = message.design_capacity = message.temperature = nan
    message.power_supply_status = message.POWER_SUPPLY_STATUS_DISCHARGING
    message.present = True
    message.cell_voltage = list(battery.cells)
    return message


main = main_of(Px4BridgeNode)


if __name__ == "__main__":
    main()
