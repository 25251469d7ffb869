"""Whatever is commanded, in whatever order: no exception, no NaN, still rotors when disarmed."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from vehicle_bench import hovering, ready

from tombo_dynamics.records import numbers
from tombo_px4 import modes
from tombo_px4.autopilot.parameters import PARAMETERS
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.link.decoded_messages import Result

odd = st.sampled_from([0.0, 1.0, -1.0, 0.3, 50.0, -1e4, 1e300, math.nan, math.inf, -math.inf])
axes = st.none() | st.tuples(odd, odd, odd).map(np.array)
quaternions = (
    st.none()
    | st.tuples(odd, odd, odd, odd).map(np.array)
    | st.just(np.array([0.0, 0.7, 0.0, 0.7]))
)
targets = st.builds(
    OffboardSetpoint,
    position=axes,
    velocity=axes,
    acceleration=axes,
    yaw=odd,
    yaw_rate=odd,
    attitude=quaternions,
    rates=axes,
    thrust=st.none() | odd,
    frame=st.sampled_from(["map", "body"]),
)
calls = st.one_of(
    st.tuples(st.just("target"), targets),
    st.tuples(st.just("set_mode"), st.builds(modes.Mode, st.integers(-3, 9), st.integers(0, 8))),
    st.tuples(st.just("set_mode"), st.just(modes.OFFBOARD)),
    st.tuples(st.just("arm"), st.booleans()),
    st.tuples(st.just("disarm"), st.booleans()),
    st.tuples(st.just("takeoff"), st.none() | odd),
    st.tuples(st.just("reposition"), axes.filter(lambda v: v is not None)),
    st.tuples(st.just("set_home"), axes),
    st.tuples(st.sampled_from(["land", "return_home", "hold", "terminate", "set_origin"])),
    st.tuples(st.just("vision"), st.integers(-600_000, 20_000), axes, quaternions),
    st.tuples(st.just("parameter"), st.sampled_from(PARAMETERS), st.floats(0.0, 1.0)),
    st.tuples(st.just("wait"), st.integers(1, 1500)),
)


def obey(flight, call) -> None:
    vehicle = flight.vehicle
    name, *given_values = call
    if name == "wait":
        flight.fly(1e-3 * given_values[0])
    elif name == "set_origin":
        flight.ekf2.origin_known = True
    elif name == "vision":
        stamp, position, attitude = given_values
        if position is not None and attitude is not None:
            vehicle.vision(vehicle.boot_us + stamp, position, attitude)
    elif name == "parameter":
        p, share = given_values
        value = p.low + share * (p.high - p.low)
        vehicle.parameters.set(p.name, round(value) if p.kind == "int32" else value)
    else:
        answer = getattr(vehicle, name)(*given_values)
        assert answer is None or isinstance(answer, Result | str)
    flight.fly(0.03)


def check(flight) -> None:
    vehicle = flight.vehicle
    assert np.isfinite(numbers(vehicle.simulator.plant.state)).all()
    estimate = vehicle.estimate
    for values in (estimate.position, estimate.velocity, estimate.attitude, estimate.rates):
        assert np.isfinite(values).all()
    assert abs(np.linalg.norm(estimate.attitude) - 1.0) < 1e-6
    assert np.isfinite(vehicle.normalized_rotor_speeds).all()
    if not vehicle.armed:
        assert vehicle.normalized_rotor_speeds.max() == 0.0
    assert isinstance(vehicle.mode, modes.Mode) and vehicle.mode.main > 0
    assert vehicle.health.problems is not None and math.isfinite(vehicle.thrust)


@pytest.mark.slow
@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.booleans(), st.booleans(), st.lists(calls, min_size=3, max_size=25))
def test_any_sequence_of_commands(vision, aloft, sequence):
    flight = hovering(vision) if aloft else ready(vision)
    for call in sequence:
        obey(flight, call)
        check(flight)
