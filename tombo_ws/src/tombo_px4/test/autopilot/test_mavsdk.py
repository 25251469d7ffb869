"""MAVSDK flies the simulated vehicle as it would fly a PX4, by its public interface alone."""

import math
import time
from types import SimpleNamespace

import pytest
from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.offboard import Attitude, Offboard, PositionNedYaw, VelocityNedYaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import FlightMode, LandedState, Telemetry
from px4_process import px4_process

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def vehicle():
    with px4_process("no_obstacle") as px4:
        sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
        plugins = []
        try:
            sdk.add_any_connection(f"udpin://127.0.0.1:{px4.port}")
            system = sdk.first_autopilot(60.0)
            assert system is not None
            plugins = [kind(system) for kind in (Action, Offboard, Param, Telemetry)]
            yield SimpleNamespace(
                action=plugins[0], offboard=plugins[1], param=plugins[2], telemetry=plugins[3]
            )
        finally:
            for plugin in plugins:
                plugin.destroy()
            sdk.destroy()


def until(condition, seconds=60.0, what=""):
    """Wait, with an end, until something is so."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.05)
    raise AssertionError(f"not within {seconds} s: {what or condition}")


def place(vehicle):
    p = vehicle.telemetry.position_velocity_ned().position
    return p.north_m, p.east_m, p.down_m


def has_reached(vehicle, goal, distance=0.25):
    return math.dist(place(vehicle), goal) < distance


def hover_thrust(vehicle):
    return vehicle.param.get_param_float("MPC_THR_HOVER")


def test_a_flight_by_action_and_offboard(vehicle):
    action, offboard, t = vehicle.action, vehicle.offboard, vehicle.telemetry
    until(t.health_all_ok)
    action.set_takeoff_altitude(1.0)
    action.arm()
    until(t.armed)
    action.takeoff()
    until(lambda: t.landed_state() == LandedState.IN_AIR and t.flight_mode() == FlightMode.HOLD)
    until(lambda: abs(t.position().relative_altitude_m - 1.0) < 0.2)
    with pytest.raises(ActionError):
        action.disarm()

    goal = (0.6, 0.4, -1.2)
    offboard.set_position_ned(PositionNedYaw(*goal, 90.0))
    offboard.start()
    until(lambda: t.flight_mode() == FlightMode.OFFBOARD)
    until(lambda: has_reached(vehicle, goal), what="position set point")

    offboard.set_velocity_ned(VelocityNedYaw(-0.4, 0.0, 0.0, 90.0))
    until(lambda: t.velocity_ned().north_m_s < -0.25, what="velocity set point")

    level = place(vehicle)[2]
    offboard.set_attitude(Attitude(0.0, 0.0, 90.0, 1.15 * hover_thrust(vehicle)))
    until(lambda: place(vehicle)[2] < level - 0.3, what="attitude and thrust")
    offboard.set_position_ned(PositionNedYaw(*goal, 90.0))
    until(lambda: has_reached(vehicle, goal), what="back from attitude")
    offboard.set_attitude(Attitude(0.0, -5.0, 90.0, hover_thrust(vehicle)))
    until(lambda: abs(t.attitude_euler().pitch_deg + 5.0) < 1.0, what="pitch")

    offboard.stop()
    until(lambda: t.flight_mode() == FlightMode.HOLD)
    action.goto_location(t.position().latitude_deg, t.position().longitude_deg + 8e-6, 489.0, 90.0)
    until(lambda: place(vehicle)[1] > goal[1] + 0.4, what="goto_location")
    action.land()
    until(lambda: t.landed_state() == LandedState.ON_GROUND)
    if t.armed():
        action.disarm()
    until(lambda: not t.armed())
