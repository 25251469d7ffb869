"""Between command and rotor speed: lag, delay, battery."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_vehicle import Vehicle, hover_speed

from tombo_dynamics.records import numbers


def step(k):
    return np.full(4, 600.0 if k >= 50 else 400.0)


def ramp(k):
    return 400.0 + k * np.array([1.0, 2.0, 0.5, 0.0])


def speeds(effects, command=step, seconds=0.25, **more):
    v = Vehicle(effects, speed=400.0, position=(0.0, 0.0, 50.0), **more)
    return v.fly(seconds, command, watch=lambda v: v.plant.rotor_speed.copy())


# --- lag ------------------------------------------------------------------------------------


@pytest.mark.parametrize("extra", [-0.02, 0.0, 0.03, 0.1])
def test_motor_lag_moves_the_63_percent_time(vehicle, extra):
    tau = vehicle.motor_time_constant + extra
    seen = speeds({"motor_lag": {"extra_tau": extra}}, seconds=0.5)[:, 0]
    reached = np.argmax(seen >= 400.0 + 200.0 * (1.0 - math.exp(-1.0)) - 1e-9)
    # seen before the tick that asks: the step shows a tick later
    assert (reached - 50) * 1e-3 == pytest.approx(tau, abs=1.1e-3)


# --- delay ----------------------------------------------------------------------------------


@pytest.mark.parametrize("ticks", [1, 7, 15, 60])
def test_command_delay_shifts_everything_by_exactly_that_time(ticks):
    prompt = speeds({})
    late = speeds({"command_delay": {"delay": ticks * 1e-3}})
    assert (prompt[:51] == 400.0).all()
    assert late[ticks:] == pytest.approx(prompt[:-ticks], rel=1e-12)


@given(st.floats(0.0, 0.06))
def test_a_delay_between_ticks_lies_between_its_neighbours(delay):
    """On a ramp interpolation is exact: the target is the command of that time ago."""
    v = Vehicle({"command_delay": {"delay": delay}}, speed=400.0, position=(0.0, 0.0, 50.0))
    v.fly(0.1, ramp)
    v.plant.rotor_command = ramp(100)
    v.begin()
    assert v.plant.rotor_target == pytest.approx(ramp(100 - delay * 1e3), rel=1e-9)


# --- battery --------------------------------------------------------------------------------


def sagging(resistance=0.0, discharge=0.0, seconds=1.0, speed=None):
    v = Vehicle(
        {"battery_sag": {"resistance": resistance, "discharge": discharge}},
        speed=hover_speed() if speed is None else speed, position=(0.0, 0.0, 500.0),
    )  # fmt: skip
    v.fly(seconds)
    return v


def test_voltage_falls_by_resistance_times_current(vehicle):
    v = sagging(resistance=0.05)
    charge, current, voltage = numbers(v.plant.supply)
    assert current > 5.0
    assert voltage == pytest.approx(vehicle.battery_voltage - 0.05 * current, rel=1e-4)
    assert charge == pytest.approx(current / 3600.0, rel=0.05)


def test_current_feeds_the_mechanical_power_at_the_drives_efficiency():
    v = sagging(resistance=0.05)
    _, current, voltage = numbers(v.plant.supply)
    mechanical = v.plant.rotor_torque @ v.plant.rotor_speed
    assert mechanical / (current * voltage) == pytest.approx(0.7, rel=1e-3)


def test_speed_and_thrust_fall_with_the_voltage(vehicle):
    v = sagging(resistance=0.1)
    share = v.plant.supply.voltage / vehicle.battery_voltage
    assert 0.5 < share < 0.99
    assert v.plant.rotor_speed / hover_speed() == pytest.approx(np.full(4, share), rel=1e-3)
    assert v.plant.rotor_thrust.sum() < 0.97 * v.mass * 9.80665


def test_voltage_falls_with_the_charge_used(vehicle):
    v = sagging(discharge=3.0, seconds=5.0)
    charge = v.plant.supply.charge
    assert v.plant.supply.voltage == pytest.approx(
        vehicle.battery_voltage - 3.0 * charge, abs=1e-3
    )
    assert charge == pytest.approx(5.0 * v.plant.supply.current / 3600.0, rel=0.05)
