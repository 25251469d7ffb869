"""What PX4 is shown: every sign, frame and unit of the simulated sensors."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from tombo_px4.hil.flight import HilFlight, HilSensors, MotorCommands
from tombo_sim.world import SpreadParams, World

AT_ORIGIN = SpreadParams(start=0.0, yaw=0.0, obstacle=0.0)


class Shown:
    """A vehicle and what PX4 hears of it."""

    def __init__(self, world: World | None = None, seed: int = 1, **params: Any) -> None:
        self.flight = HilFlight(world or World(spread=AT_ORIGIN), seed, **params)
        self.plant = self.flight.simulator.plant
        self.parser = common.MAVLink(None)

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


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_strike_stops_at_what_px4_can_hold_and_keeps_its_sign(sign):
    """2048 steps to a g, 32 768 to 2000 deg/s, in 16 bits; 32 767 is clipped, more would wrap."""
    sensors = HilSensors(0)
    sensors.observe(np.array([sign * 50.0] * 3 + [sign * 400.0] * 3))
    values = np.array(sensors.inertial(), np.float32)
    step = np.repeat(np.array([9.80665 / 2048, np.radians(2000 / 32768)], np.float32), 3)
    counts = (values / step).astype(np.int32)
    assert counts.tolist() == [sign * 32_767, -sign * 32_767, -sign * 32_767] * 2


# ---- signs


def test_gyro_and_accelerometer_are_front_right_down():
    sensors = HilSensors(0)
    sensors.observe(np.array([0.1, 0.2, 0.3, 1.0, 2.0, 9.0]))  # base_link: front, left, up
    assert sensors.inertial() == pytest.approx([1.0, -2.0, -9.0, 0.1, -0.2, -0.3], abs=0.1)


@pytest.mark.parametrize("yaw", [0.0, 1.2, -2.5])
def test_the_magnetometer_shows_the_heading(yaw):
    """Level, the field's horizontal part points 3.3 degrees east of north, the rest down."""
    shown = Shown()

    def turned():
        shown.hang()
        shown.attitude(yaw=yaw)

    message = slow_message(shown, turned)
    heading = math.radians(3.3) - math.atan2(message.ymag, message.xmag)
    assert math.remainder(heading - (0.5 * math.pi - yaw), math.tau) == pytest.approx(0, abs=0.03)
    assert message.zmag == pytest.approx(0.48 * math.sin(math.radians(63.1)), abs=0.02)


# ---- barometer, thermometer, pitot tube


def test_the_barometer_reads_956_hpa_at_488_m():
    shown = Shown()
    message = slow_message(shown, shown.settle)
    assert message.abs_pressure == pytest.approx(956.0, abs=0.3)
    assert message.pressure_alt == pytest.approx(488.2, abs=0.3)
    assert message.temperature == pytest.approx(11.8, abs=0.1)


# ---- GPS


def test_gps_speaks_of_motion_in_centimetres_a_second_north_east_down():
    shown = Shown()
    fixes = []
    for _ in range(400):
        shown.plant.state.position[2] = 50.0
        shown.plant.state.velocity = [1.0, 2.0, 0.5]
        fixes += [m for kind, m in shown.step().items() if kind == "HIL_GPS"]

    def mean(*names: str) -> Any:
        return np.mean([[getattr(fix, name) for name in names] for fix in fixes], axis=0)

    assert np.diff([fix.time_usec for fix in fixes[1:]]) == pytest.approx(100_000, abs=4000)
    assert mean("vn", "ve", "vd") == pytest.approx([200, 100, -50], abs=10)
    assert mean("vel", "cog") == pytest.approx([224, 2657], abs=70)
    assert mean("alt") == pytest.approx([538_000], abs=200)


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
