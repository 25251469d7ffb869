"""The cascade behind its inputs: which of them may fail, and how it flies then."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from control_bench import VEHICLE, quaternion, rotor_table

from core_calls import Command, Controller, StampedEstimate, take_over
from lockstep_bench import Lockstep, calm, hover_at, odometry_of
from tombo_control.controller_core import reset_inputs
from tombo_control.params import ControlParams, InputLimits
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotor_maps import speed_for_thrust
from tombo_dynamics.time_base import TICK_NS

_ZERO = np.zeros(3)
_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


class _Bench:
    """A controller that is told it hovers, perfectly, at 2 m."""

    def __init__(self, *, flies: bool = True) -> None:
        maps = rotor_table()
        self.controller = Controller(ControlParams(), VEHICLE, InputLimits(), maps)
        if flies:
            take_over(self.controller)
        self.tick = 1000
        self.height = 2.0 if flies else 0.18
        self.attitude = _LEVEL
        self.hover = speed_for_thrust(maps, VEHICLE.hover_thrust())

    @property
    def now_ns(self) -> int:
        return self.tick * TICK_NS

    def estimate(self, **more: Any) -> bool:
        values: dict[str, Any] = {
            "stamp_ns": self.now_ns,
            "position": np.array([0.0, 0.0, self.height]),
            "velocity": _ZERO,
            "attitude": self.attitude,
            "rates": _ZERO,
            "gyro_bias": _ZERO,
            "accel_bias": _ZERO,
            "pose_stamp_ns": self.now_ns,
        }
        return self.controller.estimate(odometry_of(StampedEstimate(**{**values, **more})))

    def setpoint(self, **more: Any) -> bool:
        message = hover_at(0.0, 0.0, self.height)
        return self.controller.setpoint(replace(message, **more), self.now_ns)

    def run(
        self, ticks: int, *, estimate: bool = True, pose: bool = True, setpoint: bool = True
    ) -> Command:
        command = None
        for _ in range(ticks):
            self.tick += 1
            if estimate:
                self.estimate()
            if pose:
                self.controller.biases(_ZERO, self.now_ns)
            if setpoint and self.tick % 20 == 0:
                self.setpoint()
            command = self.controller.tick(self.now_ns, self.now_ns, _ZERO)
        assert command is not None
        return command


@pytest.fixture
def bench() -> _Bench:
    ready = _Bench()
    ready.run(200)
    return ready


def _away(rows: Array) -> float:
    return float(np.linalg.norm(rows[:, :3] - [0.0, 0.0, 2.0], axis=1).max())


# --- the nodes' chain against the headless flight


@lru_cache
def _undisturbed() -> tuple[Any, Array]:
    plan = ("climb_speed=1.0", "approach_time=5.0", "land_time=8.0")
    scenario = calm(*(f"mission.{setting}" for setting in plan), "duration=14.5")
    return scenario, Lockstep(scenario, 1).fly(14.5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("late", "loss", "position", "attitude"), [(1, 0.0, 1e-2, 5e-3), (3, 0.1, 5e-2, 5e-2)]
)
def test_with_odometry_at_250_hz_late_and_lossy_it_flies_nearly_alike(
    late: int, loss: float, position: float, attitude: float
) -> None:
    scenario, truth = _undisturbed()
    flight = Lockstep(scenario, 1)
    flight.odometry_ticks, flight.late_ticks, flight.loss = 4, late, loss
    off = np.abs(flight.fly(len(truth) * 1e-3) - truth)
    assert flight.mission.mode == Phase.LANDED
    assert off[:, :3].max() < position
    assert off[:, 6:10].max() < attitude
    assert (flight.observer.memory.lost_samples > 500) == (loss > 0.0)


def test_the_slower_loops_run_at_50_and_250_hz(bench: _Bench) -> None:
    ran = [bench.run(1) for _ in range(1000)]
    assert sum(command.position_ran for command in ran) == 50
    assert sum(command.attitude_ran for command in ran) == 250


def test_a_hovering_vehicle_gets_hover_speed_stamped_with_its_gyro_sample(bench: _Bench) -> None:
    command = bench.run(1)
    assert np.allclose(command.speed, bench.hover, rtol=0.02)
    assert command.stamp_ns == bench.now_ns
    assert not command.blind
    assert not command.setpoint_late


# --- set points


@pytest.mark.parametrize("phase", [Phase.IDLE, Phase.LANDED])
def test_on_the_ground_the_rotors_stand_still(phase: int) -> None:
    bench = _Bench(flies=False)
    for _ in range(100):
        bench.setpoint(phase=Phase.IDLE)
        assert not bench.run(20, setpoint=False).speed.any()
    bench.setpoint(phase=Phase.TAKEOFF)
    bench.run(20, setpoint=False)
    for bench.height in (*np.linspace(0.18, 2.0, 20), *np.linspace(2.0, 0.18, 20)):
        bench.run(1)
    assert bench.run(20).speed.min() > 0.5 * bench.hover
    bench.setpoint(phase=phase)
    assert not bench.run(1, setpoint=False).speed.any()
    bench.setpoint(phase=Phase.HOVER)
    assert not bench.run(40).speed.any(), "it takes a take-off to fly again"
    bench.setpoint(phase=Phase.IDLE)
    assert not bench.run(20, setpoint=False).speed.any()
    bench.setpoint(phase=Phase.TAKEOFF)
    assert not bench.run(40, setpoint=False).speed.any(), "one that is asked for"
    bench.setpoint(phase=Phase.TAKEOFF, takeoff_commands=1)
    assert bench.run(40, setpoint=False).speed.min() > 0.9 * bench.hover, "phase idle was missed"


@pytest.mark.parametrize(("tilt", "obeyed"), [(0.2, True), (0.3, False)])
def test_a_take_off_begins_on_level_legs_only(tilt: float, obeyed: bool) -> None:
    bench = _Bench(flies=False)
    bench.attitude = quaternion((1.0, 0.0, 0.0), tilt)
    for phase in (*100 * [Phase.IDLE], Phase.TAKEOFF):
        bench.setpoint(phase=phase)
        command = bench.run(20, setpoint=False)
    assert command.speed.any() == obeyed


def test_a_command_from_before_it_latched_is_not_obeyed_again(bench: _Bench) -> None:
    bench.setpoint(phase=Phase.IDLE, takeoff_commands=1)
    bench.run(20, setpoint=False)
    bench.controller.command("kill")
    for phase in (Phase.IDLE, Phase.TAKEOFF, Phase.HOVER):
        bench.setpoint(phase=phase, takeoff_commands=1)
        assert not bench.run(40, setpoint=False).speed.any()
    bench.setpoint(phase=Phase.IDLE, takeoff_commands=0)  # the mission was restarted
    assert not bench.run(40, setpoint=False).speed.any()
    bench.setpoint(phase=Phase.TAKEOFF, takeoff_commands=1)
    assert bench.run(40, setpoint=False).speed.min() > 0.9 * bench.hover


@pytest.mark.parametrize(
    "wrong",
    [
        {"position": np.array([np.nan, 0.0, 2.0])},
        {"acceleration": np.array([0.0, -np.inf, 0.0])},
        {"yaw": float("nan")},
    ],
)
def test_a_set_point_that_is_not_finite_is_refused_and_is_no_sign_of_life(
    bench: _Bench, wrong: dict[str, Any]
) -> None:
    before = bench.run(1).speed
    assert not bench.setpoint(**wrong)
    assert np.allclose(bench.run(19, setpoint=False).speed, before, rtol=1e-3)
    for _ in range(400):
        bench.setpoint(**wrong)
        command = bench.run(1, setpoint=False)
    assert command.setpoint_late


@pytest.mark.slow
def test_without_set_points_it_holds_the_last_one_and_follows_those_that_come(
    flight: Lockstep,
) -> None:
    begin = flight.simulator.tick * 1e-3
    flight.steer = lambda t: hover_at(t - begin, 0.0, 2.0, (1.0, 0.0, 0.0))
    flight.fly(3.0)
    last = hover_at(flight.simulator.tick * 1e-3 - begin, 0.0, 2.0)
    flight.steer = lambda _: None
    flight.fly(0.25)
    assert not flight.command.setpoint_late
    rows = flight.fly(5.0)
    assert flight.command.setpoint_late
    assert np.linalg.norm(flight.position - last.position) < 0.1
    assert np.linalg.norm(rows[-1, 3:6]) < 0.1
    flight.steer = lambda _: hover_at(3.5, 0.0, 2.0)
    flight.fly(4.0)
    assert not flight.command.setpoint_late
    assert abs(flight.position[0] - 3.5) < 0.1


# --- estimates


@pytest.mark.parametrize(
    "wrong",
    [
        {"position": np.array([np.nan, 0.0, 2.0])},
        {"velocity": np.array([0.0, np.inf, 0.0])},
        {"attitude": np.array([0.0, 0.0, 0.0, 1.1])},
        {"attitude": np.zeros(4)},
        {"stamp_ns": 1100 * TICK_NS},
    ],
)
def test_a_bad_estimate_is_refused_and_changes_nothing(
    bench: _Bench, wrong: dict[str, Any]
) -> None:
    before = bench.run(1).speed
    bench.tick += 1
    assert not bench.estimate(**wrong)
    assert np.allclose(bench.run(19).speed, before, rtol=1e-3)


def test_the_bias_is_taken_from_the_gyro(bench: _Bench) -> None:
    bias = np.array([0.05, -0.1, 0.2])
    for _ in range(400):
        bench.tick += 1
        bench.estimate()
        bench.controller.biases(bias, bench.now_ns)
        bench.setpoint()
        command = bench.controller.tick(bench.now_ns, bench.now_ns, bias)
    assert np.allclose(command.speed, bench.hover, rtol=0.02)


@pytest.mark.slow
def test_old_poses_behind_fresh_odometry_are_not_flown_on(flight: Lockstep) -> None:
    flight.mocap_on = False
    flight.fly(0.2)
    assert not flight.command.blind
    flight.fly(0.15)
    assert flight.command.blind
    flight.mocap_on = True
    flight.fly(0.4)
    assert not flight.command.blind
    assert _away(flight.fly(2.0)) < 0.3


# --- gyro and clock


@pytest.mark.slow
def test_a_gyro_sample_that_is_not_finite_is_flown_over(flight: Lockstep) -> None:
    for _ in range(20):
        flight.fly(0.01)
        now = flight.now_ns
        command = flight.controller.tick(now, now, np.array([np.nan, np.inf, 0.0]))
        assert command is not None
        assert np.isfinite(command.speed).all()
        flight.simulator.advance(command.speed)
    assert _away(flight.fly(2.0)) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("gap_s", [0.005, 0.05, 0.2])
def test_it_survives_a_gap_of_the_gyro(flight: Lockstep, gap_s: float) -> None:
    flight.imu_on = False
    flight.fly(gap_s)
    flight.imu_on = True
    assert _away(flight.fly(3.0)) < 0.3


def test_a_clock_set_back_is_followed_and_silence_is_still_noticed(bench: _Bench) -> None:
    bench.tick += 100_000
    bench.run(200)
    bench.tick -= 50_000
    assert bench.run(40, estimate=False).blind, "estimates of the clock before are not fresh"
    assert bench.run(160).blind
    assert not bench.run(200).blind, "it is trusted after 0.3 s"
    assert bench.run(400, setpoint=False).setpoint_late
    bench.tick -= 40_000
    assert bench.run(400, setpoint=False).setpoint_late


def test_what_is_forgotten_lifts_no_vehicle_off(bench: _Bench) -> None:
    bench.run(200)
    reset_inputs(bench.controller.memory)
    assert not np.any(bench.run(200, setpoint=False).speed)
    fresh = _Bench(flies=False)
    for restarted in (bench, fresh):  # nor does a set point in the middle of a flight
        for _ in range(300):
            restarted.tick += 1
            restarted.estimate()
            restarted.setpoint()
            command = restarted.controller.tick(restarted.now_ns, restarted.now_ns, _ZERO)
        assert command is None


# --- parameters in flight


@pytest.mark.slow
def test_other_gains_in_flight_do_count(flight: Lockstep) -> None:
    speeds = []
    for p in (0.3, 1.5):
        other = copy.deepcopy(flight)
        gains = replace(other.scenario.control, position_p=p)
        other.controller.set_params("control", gains)
        other.steer = lambda _: hover_at(0.5, 0.0, 2.0)
        speeds.append(float(other.fly(1.5)[:, 3].max()))
    assert speeds[1] > 2.0 * speeds[0]
