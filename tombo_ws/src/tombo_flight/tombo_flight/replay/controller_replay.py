"""The controller over gyro samples, estimates and set points, as its node would have seen them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable
from tombo_control.controller_core import ControllerCore
from tombo_control.estimate import Estimate, Setpoint
from tombo_control.params import InputLimits
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import body_to_map
from tombo_dynamics.rotor_maps import rotor_maps
from tombo_flight.replay.merge_streams import merge_by_arrival
from tombo_flight.replay.outputs import Series
from tombo_flight.replay.poses import vectors
from tombo_flight.scenario import Scenario
from tombo_sim.propeller_effects import thrust_map_of

Times = NDArray[np.int64]
_BIASES, _ODOMETRY, _SETPOINT, _GYRO = range(4)


def replay_controller(
    imu: ColumnTable,
    odometry: ColumnTable,
    setpoints: ColumnTable,
    status: ColumnTable,
    scenario: Scenario,
) -> Series:
    """Feed everything in order of arrival; return the rotor speeds asked for [rad/s].

    Args:
        imu: columns of sensor_msgs/Imu.
        odometry: columns of nav_msgs/Odometry.
        setpoints: columns of tombo_msgs/PositionSetpoint.
        status: columns of tombo_msgs/EstimatorStatus.
        scenario: its vehicle, propeller and gains.
    """
    maps = rotor_maps(thrust_map_of(scenario.propeller), scenario.vehicle)
    controller = ControllerCore(scenario.control, scenario.vehicle, InputLimits(), maps)
    estimates = _estimates(odometry)
    wishes = _setpoints(setpoints)
    bias = vectors(status, "gyro_bias")
    pose_stamps = (
        status["pose_stamp.sec"].astype(np.int64) * 1_000_000_000 + status["pose_stamp.nanosec"]
    ).tolist()
    gyro, stamps = vectors(imu, "angular_velocity"), imu["stamp_ns"].tolist()
    commands: list[Array] = []
    answered: list[int] = []
    for now, stream, row in merge_by_arrival(
        status["log_time_ns"],
        odometry["log_time_ns"],
        setpoints["log_time_ns"],
        imu["log_time_ns"],
    ):
        if stream == _GYRO:
            command = controller.tick(now, stamps[row], gyro[row])
            if command is not None:
                commands.append(command.speed)
                answered.append(stamps[row])
        elif stream == _ODOMETRY:
            controller.estimate(estimates[row])
        elif stream == _SETPOINT:
            controller.setpoint(wishes[row], now)
        else:
            controller.biases(bias[row], pose_stamps[row])
    return Series(np.array(answered, np.int64), np.array(commands).reshape(-1, 4))


def _estimates(odometry: ColumnTable) -> list[Estimate]:
    attitude = vectors(odometry, "pose.pose.orientation", "xyzw")
    velocity = body_to_map(attitude, vectors(odometry, "twist.twist.linear"))
    position = vectors(odometry, "pose.pose.position")
    rates = vectors(odometry, "twist.twist.angular")
    nothing = np.zeros(3)
    return [
        Estimate(stamp, position[i], velocity[i], attitude[i], rates[i], nothing, nothing, 0)
        for i, stamp in enumerate(odometry["stamp_ns"].tolist())
    ]


def _setpoints(table: ColumnTable) -> list[Setpoint]:
    position, velocity = vectors(table, "position"), vectors(table, "velocity")
    acceleration = vectors(table, "acceleration")
    return [
        Setpoint(position[i], velocity[i], acceleration[i], float(yaw), int(phase), int(stamp))
        for i, (yaw, phase, stamp) in enumerate(
            zip(table["yaw"], table["phase"], table["stamp_ns"], strict=True)
        )
    ]
