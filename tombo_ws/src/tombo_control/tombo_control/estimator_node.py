"""The estimator as a node: IMU and mocap poses in, odometry out."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tombo_bag.topics import (
    ESTIMATOR_STATUS,
    IMU,
    MARKERS,
    MISSION_STATUS,
    MOCAP_POSE,
    ODOMETRY,
    TF,
)
from tombo_control.estimate import Estimate, nearest_tick
from tombo_control.estimator_core import EstimatorCore
from tombo_control.params import EstimatorParams
from tombo_dynamics.rotation import rotate_vectors
from tombo_dynamics.vehicle import VehicleParams
from tombo_ros.conversion import array, to_ns
from tombo_ros.health import ERROR
from tombo_ros.markers import disc_markers
from tombo_ros.message_template import MessageTemplate
from tombo_ros.node_loop import LoopNode, run
from tombo_ros.pacing import ESTIMATOR
from tombo_ros.topic import message_class

_ODOMETRY_TICKS, _STATUS_TICKS, _TF_TICKS, _DISC_TICKS = 4, 20, 20, 100
_POSE_SILENT_S = 0.12
"""Three samples at 30 Hz and a half."""
_IMU_SILENT_S = 0.05
_REFUSALS = {
    "wrong_frame": "a pose whose frame is not map",
    "not_finite": "a pose with NaN or infinity",
    "not_unit": "a pose whose quaternion is no rotation",
    "future": "a pose stamped in the future",
    "out_of_order": "a pose not newer than the one before",
    "late": "a pose more than half a second old",
    "jump": "a pose too far from the estimate",
}


class EstimatorNode(LoopNode):
    """Runs `EstimatorCore` on what arrives: some four gyro samples a run, each in its turn.

    The controller carries the estimate on with its own gyro, so 4 ms more cost nothing, and a wake
    for each sample would cost a tenth of a core.
    """

    def __init__(self) -> None:
        """Declare parameters and topics."""
        records = {"estimator": EstimatorParams(), "vehicle": VehicleParams()}
        super().__init__("estimator", 250.0, records, priority=ESTIMATOR)
        self._observer = EstimatorCore(self.records["estimator"], self.records["vehicle"])
        self._warm_up()
        self._imu_in = self.subscribe(IMU, depth=200)
        self._pose_in = self.subscribe(MOCAP_POSE, depth=20)
        self._phase_in = self.subscribe(MISSION_STATUS)
        self._imu = MessageTemplate(
            IMU.typename,
            {"header": {"frame_id": "base_link"}, "orientation_covariance": [-1.0] + 8 * [0.0]},
        )
        self._gyro = self._imu.field("angular_velocity.x", 3)
        self._accel = self._imu.field("linear_acceleration.x", 3)
        self._odometry_out, self._odometry = (
            self.advertise(ODOMETRY),
            MessageTemplate(
                ODOMETRY.typename, {"header": {"frame_id": "map"}, "child_frame_id": "base_link"}
            ),
        )
        self._pose_field = self._odometry.field("pose.pose.position.x", 7)
        self._twist_field = self._odometry.field("twist.twist.linear.x", 6)
        self._status_out, self._status = (
            self.advertise(ESTIMATOR_STATUS),
            MessageTemplate(ESTIMATOR_STATUS.typename, {"header": {"frame_id": "base_link"}}),
        )
        self._markers = self.advertise(MARKERS)
        self._tf_out, self._tf = self._transforms()
        self._hubs = self.records["vehicle"].rotor_positions()

    def _warm_up(self) -> None:
        """Load all compiled code now, not at the first sample."""
        spare = EstimatorCore(self.records["estimator"], self.records["vehicle"])
        level = np.array([0.0, 0.0, 0.0, 1.0])
        for k in range(120):
            now = 1_000_000_000 + k * 1_000_000
            if k % 30 == 0:
                spare.pose(now, now, "map", np.zeros(3), level)
            spare.imu(now, np.zeros(3), np.array([0.0, 0.0, 9.8]))
        rotate_vectors(level, np.zeros(3))

    def _transforms(self) -> tuple[Any, Any]:
        """Return topic and shape of /tf, or nothing where tf2_msgs is not installed."""
        try:
            message_class(TF.typename)
        except ImportError:
            self.ros.get_logger().info("tf2_msgs is not installed: no /tf; poses are on /odometry")
            return None, None
        one = {"header": {"frame_id": "map"}, "child_frame_id": "base_link"}
        return self.advertise(TF), MessageTemplate(TF.typename, {"transforms": [one]})

    def on_parameters_changed(self, name: str) -> None:
        """Take new bandwidths in flight; another vehicle only at the next start."""
        if name == "estimator":
            self._observer.params(self.records["estimator"])

    def step(self, now_ns: int) -> None:
        """Take poses, then the gyro samples in their order."""
        for taken in self._phase_in.take():
            self._observer.phase(int(taken.message.phase))
        wall_ns = time.time_ns()  # arrivals are stamped by the system's clock
        multiple_publishers = self._pose_in.multiple_publishers(wall_ns)
        for taken in self._pose_in.take():
            if not multiple_publishers:
                self._take_pose(taken.message, now_ns)
        samples = self._imu_in.take_raw()
        if self._imu_in.multiple_publishers(wall_ns):
            samples = []
        for taken in samples:
            self._take_imu(taken.message)
        self._watch(now_ns, wall_ns)

    def _take_pose(self, message: Any, now_ns: int) -> None:
        why = self._observer.pose(
            to_ns(message.header.stamp),
            now_ns + self.slack_ns,
            message.header.frame_id,
            array(message.pose.position),
            array(message.pose.orientation),
        )
        if why:
            self.health.report_event(f"pose_{why}", _REFUSALS[why])

    def _take_imu(self, data: bytes) -> None:
        if not self._imu.fits(data):
            self.health.report_event("imu_shape", "imu frame is not base_link, or of other shape")
            return
        gyro, accel = np.array(self._gyro.of(data)), np.array(self._accel.of(data))
        if not np.isfinite(gyro.sum() + accel.sum()):
            self.health.report_event("imu_not_finite", "imu sample with NaN or infinity")
        estimate = self._observer.imu(self._imu.stamp_of(data), gyro, accel)
        if estimate is None:
            return
        tick = nearest_tick(estimate.stamp_ns)
        if tick % _ODOMETRY_TICKS == 0:
            self._publish_odometry(estimate)
        if tick % _STATUS_TICKS == 0:
            self._publish_status(estimate)
        if tick % _TF_TICKS == 1 and self._tf_out is not None:
            self._publish_transform(estimate)
        if tick % _DISC_TICKS == 2:
            hubs = [
                estimate.position + rotate_vectors(estimate.attitude, hub) for hub in self._hubs
            ]
            radius = self.records["vehicle"].rotor_radius
            self._markers.publish(disc_markers(estimate.stamp_ns, hubs, estimate.attitude, radius))

    def _publish_odometry(self, estimate: Estimate) -> None:
        self._odometry.stamp(estimate.stamp_ns)
        self._pose_field.put((*estimate.position, *estimate.attitude))
        x, y, z, w = estimate.attitude
        moving = rotate_vectors(np.array([-x, -y, -z, w]), estimate.velocity)
        self._twist_field.put((*moving, *estimate.rates))
        self._odometry_out.publish(self._odometry.data())

    def _publish_status(self, estimate: Estimate) -> None:
        status = self._status
        status.stamp(estimate.stamp_ns)
        status.set("initialised", True)
        status.set("gyro_bias.x", *estimate.gyro_bias)
        status.set("accel_bias.x", *estimate.accel_bias)
        seconds, rest = divmod(estimate.pose_stamp_ns, 1_000_000_000)
        status.set("pose_stamp.sec", seconds)
        status.set("pose_stamp.nanosec", rest)
        status.set("poses", self._observer.poses)
        status.set("rejected", self._observer.rejected)
        self._status_out.publish(status.data())

    def _publish_transform(self, estimate: Estimate) -> None:
        path = "transforms[0]"
        seconds, rest = divmod(estimate.stamp_ns, 1_000_000_000)
        self._tf.set(f"{path}.header.stamp.sec", seconds)
        self._tf.set(f"{path}.header.stamp.nanosec", rest)
        self._tf.set(f"{path}.transform.translation.x", *estimate.position)
        self._tf.set(f"{path}.transform.rotation.x", *estimate.attitude)
        self._tf_out.publish(self._tf.data())

    def _watch(self, now_ns: int, wall_ns: int) -> None:
        """Say what is missing; ages are of arrival."""
        estimate = self._observer.estimate
        if estimate is None:
            silent = self._pose_in.silent(wall_ns, _POSE_SILENT_S)
            self.health.fault("mocap_silent", silent, "no mocap poses")
        else:
            age = (now_ns - estimate.pose_stamp_ns) * 1e-9
            text = f"the last mocap pose is {age:.2f} s old"
            self.health.fault("mocap_silent", age > _POSE_SILENT_S, text)
        silent = self._imu_in.silent(wall_ns, _IMU_SILENT_S)
        self.health.fault("imu_silent", silent, "no imu samples", ERROR)
        if estimate is not None:
            self.health.value("mocap_age_s", round(age, 3))

    def report(self, now_ns: int) -> None:
        """Add the counts."""
        self.health.value("poses", self._observer.poses)
        self.health.value("poses_rejected", self._observer.rejected)
        self.health.value("imu_lost", self._observer.lost_samples)
        super().report(now_ns)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the node."""
    sys.exit(run(EstimatorNode, argv))


if __name__ == "__main__":
    main()
