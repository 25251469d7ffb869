"""Tables as other projects write them, of a flight that is made from a formula.

Their content is turned here by hand into their axes, units and names.
"""

import numpy as np
from log_writers import px4_poses
from made_flight import made_flight
from scipy.spatial.transform import Rotation

from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.frames import frd_from_flu

FLIGHT = made_flight(duration=14.0, mocap_hz=100.0, imu_hz=100.0, seed=3)
T = FLIGHT.series["gyro"].t
P, Q = (FLIGHT.series[c].values[: T.size] for c in ("position", "attitude"))
GYRO, ACCEL = (FLIGHT.series[c].values for c in ("gyro", "accel"))
SPEED = FLIGHT.series["rotor_speed"].values
SHARE = np.clip((SPEED / 800.0) ** 2, 0.0, 1.0)
"""Commands that thrust is proportional to."""
TURN = Rotation.from_quat(Q)
M1_TO_M4 = [0, 3, 1, 2]
"""Ours as Bitcraze numbers them: front right, rear right, rear left, front left."""


def rows(columns, delimiter=",", keep=None):
    """Text of a table; NaN is an empty cell. `keep`: column → every which row it has a value."""
    lines = [delimiter.join(columns)]
    cells = [np.asarray(c, np.float64) for c in columns.values()]
    every = [(keep or {}).get(name.split(".")[0], 1) for name in columns]
    for i in range(len(T)):
        texts = (
            "" if i % n or np.isnan(c[i]) else repr(float(c[i]))
            for c, n in zip(cells, every, strict=True)
        )
        lines.append(delimiter.join(texts))
    return "\n".join(lines) + "\n"


def named(names, values):
    return dict(zip(names, values.T, strict=True))


def crazyflie():
    """cfclient: ms, degrees, g, PWM; pitch has the other sign."""
    yaw, pitch, roll = TURN.as_euler("ZYX", degrees=True).T
    return rows({
        "Timestamp": np.round(1000.0 * T) + 81_234.0,
        **named(["stateEstimate.x", "stateEstimate.y", "stateEstimate.z"], P),
        "stabilizer.roll": roll, "stabilizer.pitch": -pitch, "stabilizer.yaw": yaw,
        **named(["gyro.x", "gyro.y", "gyro.z"], np.degrees(GYRO)),
        **named(["acc.x", "acc.y", "acc.z"], ACCEL / GRAVITY),
        **named([f"motor.m{i}" for i in range(1, 5)], np.round(65535.0 * SHARE[:, M1_TO_M4])),
        "pm.vbat": 4.1 - 0.02 * T,
    })  # fmt: skip


def px4():
    """Topics of a ULog side by side: us, NED, FRD, wxyz, each at its own rate."""
    place, turn = px4_poses(FLIGHT)
    rpm = SPEED * [1.0, 1.0, -1.0, -1.0] * 30.0 / np.pi  # signed by the direction of rotation
    columns = {
        "timestamp": np.round(1e6 * T) + 5e6,
        **named([f"vehicle_local_position.{a}" for a in "xyz"], place[: T.size]),
        **named([f"vehicle_local_position.v{a}" for a in "xyz"], 0.1 * P),
        "vehicle_local_position.ref_alt": 0.0 * T,
        **named([f"vehicle_attitude.q[{i}]" for i in range(4)], turn[: T.size]),
        **named([f"sensor_combined.gyro_rad[{i}]" for i in range(3)], frd_from_flu(GYRO)),
        **named(
            [f"sensor_combined.accelerometer_m_s2[{i}]" for i in range(3)], frd_from_flu(ACCEL)
        ),
        **named([f"actuator_motors.control[{i}]" for i in range(4)], SHARE),
        **{f"actuator_motors.control[{i}]": np.nan * T for i in range(4, 12)},
        **named([f"esc_status.esc[{i}].esc_rpm" for i in range(4)], np.round(rpm)),
        "battery_status.voltage_v": 15.0 - 0.01 * T,
        "battery_status.current_a": 9.0 + 0.0 * T,
    }
    return rows(columns, keep={"vehicle_local_position": 2, "battery_status": 10})
