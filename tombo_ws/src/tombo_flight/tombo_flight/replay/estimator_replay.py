"""The estimator over IMU samples and poses, as its node would have seen them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_bag.columns import ColumnTable
from tombo_control.estimator_core import EstimatorCore
from tombo_control.params import EstimatorParams
from tombo_dynamics.rotation import map_to_body
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.replay.merge_streams import merge_by_arrival
from tombo_flight.replay.outputs import Series
from tombo_flight.replay.poses import PoseTrack, vectors


@dataclass(frozen=True)
class EstimatorReplay:
    """Estimates at the IMU's stamps."""

    position: Series
    attitude: Series
    velocity: Series
    """(N, 3) in base_link, as nav_msgs/Odometry has it."""
    poses: int
    rejected: int

    def series(self) -> dict[str, Series]:
        """Return what is compared, by name."""
        return {
            "odometry_position": self.position,
            "odometry_attitude": self.attitude,
            "odometry_velocity": self.velocity,
        }


def replay_estimator(
    poses: PoseTrack,
    imu: ColumnTable,
    status: ColumnTable | None,
    params: EstimatorParams,
    vehicle: VehicleParams,
) -> EstimatorReplay:
    """Feed IMU samples, poses and the mission's phase in order of arrival.

    Args:
        poses: of the motion capture.
        imu: columns of sensor_msgs/Imu.
        status: columns of tombo_msgs/MissionStatus; without, the vehicle is taken as airborne.
        params: of the estimator.
        vehicle: that is flown.
    """
    observer = EstimatorCore(params, vehicle)
    gyro, accel = vectors(imu, "angular_velocity"), vectors(imu, "linear_acceleration")
    stamps = imu["stamp_ns"].tolist()
    phases = [] if status is None or "phase" not in status else status["phase"].tolist()
    phase_times = status["log_time_ns"] if status is not None and phases else np.zeros(0, np.int64)
    frames = poses.frame.tolist()
    pose_stamps = poses.stamp_ns.tolist()
    estimates = []
    for now, stream, row in merge_by_arrival(phase_times, poses.arrival_ns, imu["log_time_ns"]):
        if stream == 2:
            estimate = observer.imu(stamps[row], gyro[row], accel[row])
            if estimate is not None:
                estimates.append(estimate)
        elif stream == 1:
            observer.pose(
                pose_stamps[row], now, frames[row], poses.position[row], poses.attitude[row]
            )
        else:
            observer.phase(phases[row])
    stamp = np.array([e.stamp_ns for e in estimates], np.int64)
    attitude = np.array([e.attitude for e in estimates]).reshape(-1, 4)
    velocity = np.array([e.velocity for e in estimates]).reshape(-1, 3)
    return EstimatorReplay(
        Series(stamp, np.array([e.position for e in estimates]).reshape(-1, 3)),
        Series(stamp, attitude),
        Series(stamp, map_to_body(attitude, velocity)),
        observer.poses,
        observer.rejected,
    )
