import numpy as np
import pytest
from endpoint_bench import bench
from pymavlink.dialects.v20 import common as mavlink
from vehicle_bench import table_with

from tombo_px4.autopilot.vehicle import Px4Vehicle
from tombo_px4.frames import GeoOrigin
from tombo_px4.protocol.telemetry import STREAMS, VehicleView
from tombo_sim.world import World

MAV = mavlink.MAVLink(None, 1, 1)
ORIGIN = GeoOrigin(47.0, 8.0, 400.0)
YAW = 0.7
"""Counter-clockwise from east."""


@pytest.fixture(scope="module")
def flying():
    """A vehicle on its way, turned, with its telemetry."""
    with bench() as b:
        b.take_off(0.8)
        b.vehicle.reposition(np.array([1.5, -0.8, 1.6]), YAW)
        b.run(1.4)
        yield b


@pytest.fixture
def tell(flying):
    """A function that gives a message, as it arrives."""

    def message(name):
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
        sent = STREAMS[number].message(VehicleView(flying.vehicle, ORIGIN))
        receiver = mavlink.MAVLink(None)
        (arrived,) = receiver.parse_buffer(sent.pack(MAV))
        return arrived

    return message


def test_the_odometry_has_velocity_in_the_world_and_rates_in_the_body(flying, tell):
    o, v = tell("ODOMETRY"), tell("LOCAL_POSITION_NED")
    assert o.frame_id == o.child_frame_id == mavlink.MAV_FRAME_LOCAL_NED
    assert o.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT
    assert (o.vx, o.vy, o.vz) == (v.vx, v.vy, v.vz) != (0.0, 0.0, 0.0)
    forward, left, up = flying.vehicle.estimate.rates
    rates = (o.rollspeed, o.pitchspeed, o.yawspeed)
    assert rates == pytest.approx((forward, -left, -up), abs=1e-6)


def test_the_globe_is_told_in_its_units(flying, tell):
    g = tell("GLOBAL_POSITION_INT")
    back = ORIGIN.local_of(1e-7 * g.lat, 1e-7 * g.lon, 1e-3 * g.alt)
    assert back == pytest.approx(flying.vehicle.estimate.position, abs=0.02)
    above_home = flying.vehicle.estimate.position[2] - flying.vehicle.home[2]
    assert 1e-3 * g.relative_alt == pytest.approx(above_home, abs=1e-3)
    local = tell("LOCAL_POSITION_NED")
    assert (g.vx, g.vy, g.vz) == pytest.approx(
        (100 * local.vx, 100 * local.vy, 100 * local.vz), abs=0.51
    )


def test_the_imu_is_front_right_down(flying, tell):
    imu = tell("HIGHRES_IMU")
    gx, gy, gz, fx, fy, fz = flying.vehicle.simulator.imu
    assert (imu.xgyro, imu.ygyro, imu.zgyro) == pytest.approx((gx, -gy, -gz), abs=1e-6)
    assert (imu.xacc, imu.yacc, imu.zacc) == pytest.approx((fx, -fy, -fz), abs=1e-5)
    assert imu.fields_updated & 0x3F == 0x3F


def test_a_flying_vehicle_says_so(flying, tell):
    beat = tell("HEARTBEAT")
    assert (beat.type, beat.autopilot) == (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4)
    assert beat.base_mode == 1 | 128
    assert beat.custom_mode == 4 << 16 | 3 << 24
    assert beat.system_status == mavlink.MAV_STATE_ACTIVE
    assert tell("EXTENDED_SYS_STATE").landed_state == mavlink.MAV_LANDED_STATE_IN_AIR
    status = tell("SYS_STATUS")
    assert status.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_GPS
    assert status.voltage_battery == pytest.approx(12600, abs=400)
    battery = tell("BATTERY_STATUS")
    assert sum(v for v in battery.voltages if v != 65535) == pytest.approx(
        status.voltage_battery, abs=3
    )
    assert battery.current_battery > 100
    assert tell("ESTIMATOR_STATUS").flags & mavlink.ESTIMATOR_POS_HORIZ_ABS


@pytest.mark.parametrize("parameters", [{}, {"SYS_HAS_GPS": 0, "EKF2_GPS_CTRL": 0}])
def test_every_message_can_be_packed_from_the_first_tick_on(parameters):
    vehicle = Px4Vehicle(World(), 0, table_with(**parameters))
    for _ in range(3):
        for stream in STREAMS.values():
            message = stream.message(VehicleView(vehicle, ORIGIN))
            assert message is None or message.pack(MAV)
        vehicle.step()
