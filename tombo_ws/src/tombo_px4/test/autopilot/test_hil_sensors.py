"""What PX4 is shown: every sign, frame and unit of the simulated sensors."""

import math
from typing import Any

import numpy as np
import pytest
from hil_peer import MAVLINK
from hypothesis import given
from hypothesis import strategies as st

from tombo_px4.frames import px4_quaternion
from tombo_px4.hil.flight import HilFlight, HilSensors, MotorCommands
from tombo_px4.hil.params import HilParams
from tombo_px4.protocol.telemetry_snapshot import altitude_at, ground_truth, pressure_at
from tombo_sim.world import SpreadParams, World

AT_ORIGIN = SpreadParams(start=0.0, yaw=0.0, obstacle=0.0)


class Shown:
    """A vehicle and what PX4 hears of it."""

    def __init__(self, world: World | None = None, seed: int = 1, **params: Any) -> None:
        self.flight = HilFlight(world or World(spread=AT_ORIGIN), seed, HilParams(**params))
        self.plant = self.flight.simulator.plant
        self.parser = MAVLINK.MAVLink(None)

    def step(self, *controls: float) -> dict[str, Any]:
        """The messages of one step, by name."""
        motors = MotorCommands(controls, armed=True) if controls else MotorCommands()
        arrived = self.parser.parse_buffer(self.flight.step(motors))
        return {message.get_type(): message for message in arrived or []}

    def sensor(self) -> Any:
        return self.step()["HIL_SENSOR"]

    def settle(self, steps: int = 250) -> None:
        for _ in range(steps):
            self.flight.step(MotorCommands())

    def hang(self, height: float = 50.0) -> None:
        """Lift it off the ground, at rest."""
        self.plant.state.position, self.plant.state.velocity = [0.0, 0.0, height], 0.0

    def attitude(self, yaw: float = 0.0, roll: float = 0.0) -> None:
        """Turn it: yaw from east to north, then roll right side down [rad]."""
        a, b = 0.5 * yaw, 0.5 * roll
        self.plant.state.attitude = [
            math.cos(a) * math.sin(b),
            math.sin(a) * math.sin(b),
            math.sin(a) * math.cos(b),
            math.cos(a) * math.cos(b),
        ]


def slow_message(shown: Shown, prepare: Any) -> Any:
    """The next HIL_SENSOR with all sensors, the vehicle held as prepared."""
    for _ in range(5):
        prepare()
        message = shown.sensor()
        if message.fields_updated == 0x1FFF:
            return message
    raise AssertionError("no complete message in five")


# ---- accelerometer and gyro


def test_a_message_is_the_mean_of_its_interval_and_nothing_is_left_of_it():
    sensors = HilSensors(HilParams(accel_noise=1e-3, gyro_noise=1e-4), 0)
    for k in range(4):
        sensors.observe(np.array([1.0 + k, 0.0, 0.0, 10.0 * k, 0.0, 0.0]))
    values = sensors.inertial()
    assert values[0] == pytest.approx(15.0, abs=0.01)
    assert values[3] == pytest.approx(2.5, abs=0.001)
    sensors.observe(np.zeros(6))
    assert np.abs(sensors.inertial()).max() < 0.01


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_strike_stops_at_what_px4_can_hold_and_keeps_its_sign(sign):
    """2048 steps to a g, 32 768 to 2000 deg/s, in 16 bits; 32 767 is clipped, more would wrap."""
    sensors = HilSensors(HilParams(), 0)
    sensors.observe(np.array([sign * 50.0] * 3 + [sign * 400.0] * 3))
    values = np.array(sensors.inertial(), np.float32)
    step = np.repeat(np.array([9.80665 / 2048, np.radians(2000 / 32768)], np.float32), 3)
    counts = (values / step).astype(np.int32)
    assert counts.tolist() == [sign * 32_767, -sign * 32_767, -sign * 32_767] * 2


# ---- barometer, thermometer, pitot tube


def test_the_barometer_reads_956_hpa_at_488_m():
    shown = Shown()
    message = slow_message(shown, shown.settle)
    assert message.abs_pressure == pytest.approx(956.0, abs=0.3)
    assert message.pressure_alt == pytest.approx(488.2, abs=0.3)
    assert message.temperature == pytest.approx(11.8, abs=0.1)


@given(st.floats(-400.0, 10_000.0))
def test_pressure_and_altitude_are_each_others_inverse(altitude):
    assert altitude_at(pressure_at(altitude)) == pytest.approx(altitude, abs=1e-6)


def test_pressure_falls_with_height_as_in_the_standard_atmosphere():
    assert pressure_at(0.0) == 101_325.0
    assert pressure_at(1000.0) == pytest.approx(89_874.6, abs=5.0)
    shown = Shown()
    low = slow_message(shown, lambda: shown.hang(10.0))
    high = slow_message(shown, lambda: shown.hang(110.0))
    assert high.pressure_alt - low.pressure_alt == pytest.approx(100.0, abs=0.5)
    assert low.abs_pressure - high.abs_pressure == pytest.approx(11.3, abs=0.2)


def test_the_pitot_tube_reads_the_wind_of_flying_forward():
    shown = Shown()

    def fly() -> None:
        shown.hang()
        shown.plant.state.velocity[0] = 10.0  # east, where the nose is

    assert slow_message(shown, fly).diff_pressure == pytest.approx(0.6125, abs=0.02)


# ---- GPS and truth


def test_gps_speaks_of_motion_in_centimetres_a_second_north_east_down():
    shown = Shown(gps_position_noise=0.0, gps_velocity_noise=0.0)
    fixes = []
    for _ in range(80):
        shown.plant.state.position[2] = 50.0
        shown.plant.state.velocity = [1.0, 2.0, 0.5]
        fixes += [m for kind, m in shown.step().items() if kind == "HIL_GPS"]
    last = fixes[-1]
    assert np.diff([fix.time_usec for fix in fixes[1:]]) == pytest.approx(100_000, abs=4000)
    assert (last.vn, last.ve, last.vd) == pytest.approx((200, 100, -50), abs=6)
    assert (last.vel, last.cog) == pytest.approx((224, 2657), abs=30)
    assert last.alt == pytest.approx(538_000, abs=100)


def test_gps_at_rest_is_noisy_about_the_origin_and_knows_no_course():
    shown = Shown()
    fixes = [m["HIL_GPS"] for _ in range(1000) for m in [shown.step()] if "HIL_GPS" in m]
    places = np.array([[fix.lat, fix.lon] for fix in fixes], np.float64)
    assert places.mean(axis=0) == pytest.approx([473977420, 85455940], abs=10)
    assert 3.0 < places[:, 0].std() < 30.0
    assert {fix.cog for fix in fixes if fix.vel < 10} == {65_535}


def test_no_gps_means_none():
    shown = Shown(gps=False)
    assert not any("HIL_GPS" in shown.step() for _ in range(200))


def test_the_truth_is_true():
    shown = Shown(truth_rate=250.0)
    shown.settle(2)
    shown.hang()
    shown.attitude(yaw=0.3, roll=0.2)
    shown.plant.state.velocity = [1.0, 2.0, 3.0]
    shown.plant.state.rates = [0.1, 0.2, 0.3]
    true = shown.step()["HIL_STATE_QUATERNION"]
    q = px4_quaternion(shown.plant.state.attitude)
    assert true.attitude_quaternion == pytest.approx(q.tolist(), abs=1e-6)
    rates = [true.rollspeed, true.pitchspeed, true.yawspeed]
    assert rates == pytest.approx([0.1, -0.2, -0.3], abs=0.01)
    assert [true.vx, true.vy] == pytest.approx([200, 100], abs=2)
    assert true.vz == pytest.approx(-300 + 4, abs=2)  # 4 ms of free fall
    assert true.lat == pytest.approx(473977420, abs=2)
    assert true.alt == pytest.approx(538_012, abs=3)
    assert true.true_airspeed == pytest.approx(373, abs=5)


def test_a_force_beyond_the_messages_range_is_cut_off():
    shown = Shown(truth_rate=250.0)
    shown.settle(3)
    shown.plant.force[0] = 1e6
    truth = ground_truth(shown.parser, 0, shown.flight.sensors.origin, shown.plant)
    assert truth.xacc == 32_767


# ---- the messages


def test_a_step_is_4_ms_and_every_fifth_has_all_sensors():
    shown = Shown()
    heard = [shown.sensor() for _ in range(26)]
    assert [m.time_usec for m in heard] == [4000 * k for k in range(1, 27)]
    fields = [m.fields_updated for m in heard]
    assert fields[::5] == [0x1FFF] * 6
    assert set(fields) == {0x1FFF, 0x3F}
    assert fields.count(0x1FFF) == 6
    assert {m.id for m in heard} == {0}


def test_no_reading_stands_still_even_without_effects():
    """PX4 takes a sensor that repeats itself for broken."""
    shown = Shown()
    shown.settle()
    heard = [shown.sensor() for _ in range(101)]
    for name in ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro"):
        values = [getattr(m, name) for m in heard]
        assert len(set(values)) == len(values), name
    whole = [m for m in heard if m.fields_updated == 0x1FFF]
    for name in ("xmag", "ymag", "zmag", "abs_pressure"):
        assert len({getattr(m, name) for m in whole}) > 0.9 * len(whole), name


def test_the_same_seed_gives_the_same_bytes_and_another_one_others():
    def heard(seed: int) -> bytes:
        flight = HilFlight(World(), seed, HilParams())
        return b"".join(flight.step(MotorCommands()) for _ in range(60))

    assert heard(3) == heard(3)
    assert heard(3) != heard(4)
