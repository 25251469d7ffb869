"""The bridge against the simulated PX4 and its clock, without sockets, in made-up time."""

import math

import numpy as np
import pytest
from bridge_flight import MS, NOW, STEP, ZERO, Flight, hovering

from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.messages import Phase, PositionSetpoint
from tombo_px4.bridge.session import SessionStage
from tombo_px4.bridge.vehicle_parameters import parse_assignments
from tombo_px4.modes import AUTO_LAND, OFFBOARD, POSCTL


@pytest.mark.slow
def test_a_flight_takes_off_lands_and_disarms_without_faults():
    flight = hovering()
    assert (flight.px4.mode, flight.px4.armed) == (OFFBOARD, True)
    assert flight.out.status.offboard
    assert flight.px4.place == pytest.approx([0, 0, 1.5], abs=0.05)
    flight.phase = Phase.LAND
    flight.until(lambda f: f.px4.mode == AUTO_LAND, 3.0)
    flight.until(lambda f: not f.px4.armed, 20.0)
    flight.phase = Phase.LANDED
    flight.run(3.0)
    assert flight.bridge.session.stage == SessionStage.READY
    assert not flight.events and not flight.out.faults
    assert not flight.bridge.message_decoder.refused
    assert str(flight.out.status.firmware) == "1.17.0"


@pytest.mark.slow
def test_stamps_reach_px4_within_two_milliseconds_of_the_truth():
    flight = Flight(mocap_late_ms=25).run(6.0)
    late = flight.px4.stamps[-100:]
    assert len(late) == 100
    for captured, _ in late:
        grid = (captured - NOW) % (5 * STEP)
        assert min(grid, 5 * STEP - grid) < 1 * MS, "against the true instant of capture"
    seen = np.median([arrival - captured for captured, arrival in late]) / MS
    assert 24.0 < seen < 35.0


@pytest.mark.slow
def test_without_an_estimate_nothing_is_streamed_and_nothing_armed():
    flight = Flight()
    flight.px4.deaf = lambda message: message.get_type() == "ODOMETRY"
    flight.phase, flight.goal = Phase.TAKEOFF, np.array([0.0, 0.0, 1.5])
    flight.run(8.0)
    assert not flight.px4.targets and not flight.px4.armed
    assert any("nothing is fused" in text for text in flight.out.status.findings)


@pytest.mark.slow
def test_the_estimate_is_published_once_checks_have_passed_for_a_while():
    flight = Flight()
    flight.until(lambda f: f.out.status.ready)
    flight.run(2.5)
    assert not flight.bridge.estimate_trusted
    flight.mocap_on = False
    flight.until(lambda f: not f.out.status.ready)
    flight.mocap_on = True
    flight.until(lambda f: f.out.status.ready)
    flight.run(2.5)
    assert not flight.bridge.estimate_trusted, "each fault begins the wait again"
    flight.run(0.6)
    assert flight.bridge.estimate_trusted
    flight.mocap_on = False
    flight.run(2.0)
    assert flight.bridge.estimate_trusted, "once begun, the mission goes on"


@pytest.mark.slow
def test_poses_that_stand_still_in_flight_bring_it_down():
    flight = hovering()
    last = flight.px4.place.copy(), flight.px4.attitude.copy()
    flight.as_mocap = lambda place, attitude: last
    sent = flight.bridge.poses_sent
    flight.run(0.8)
    assert flight.bridge.session.stage == SessionStage.FLYING, "a hitch is no reason"
    assert flight.bridge.poses_sent <= sent + 10, "a pose that is frozen is not sent"
    flight.stage(SessionStage.LANDING, patience_s=5.0)
    assert any("repeats its last pose" in text for key, text in flight.events if key == "landing")
    flight.until(lambda f: not f.px4.armed, patience_s=30.0)


def test_poses_that_are_no_poses_are_not_sent():
    flight = Flight().run(1.0)
    bridge, now = flight.bridge, flight.now
    level = np.array([0.0, 0.0, 0.0, 1.0])
    sent = bridge.poses_sent
    assert bridge.pose(now, now, "odom", ZERO, level) == PoseRefusal.WRONG_FRAME
    assert bridge.pose(now, now, "map", ZERO * math.nan, level) == PoseRefusal.NOT_FINITE
    assert bridge.pose(now, now, "map", ZERO, 2 * level) == PoseRefusal.NOT_UNIT
    assert bridge.pose(now + 50 * MS, now, "map", ZERO, level) == PoseRefusal.FUTURE
    assert bridge.pose(now - 500 * MS, now, "map", ZERO, level) == PoseRefusal.LATE
    assert bridge.pose(now, now, "map", ZERO, level) == PoseRefusal.NONE
    assert bridge.pose(now, now, "map", ZERO, level) == PoseRefusal.OUT_OF_ORDER
    assert bridge.poses_sent == sent + 1


@pytest.mark.slow
def test_a_silent_mission_is_held_without_feed_forward():
    flight = hovering()
    speed = np.array([0.3, 0.0, 0.2])
    flight.mission_on = False
    flight.bridge.stream.setpoint(
        PositionSetpoint(0, flight.goal, speed, speed, 0.0, Phase.HOVER), flight.now
    )
    flight.run(2.0)
    assert "no set point for" in flight.out.faults["setpoint_silent"]
    last = flight.px4.targets[-1]
    assert (last.vx, last.vy, last.vz, last.afz) == (0.0, 0.0, 0.0, 0.0)
    assert flight.px4.place == pytest.approx([0, 0, 1.5], abs=0.15)
    assert flight.px4.mode == OFFBOARD
    flight.run(flight.bridge.limits.safety.hold_time)
    assert flight.px4.mode == AUTO_LAND, "nobody says where to: it does not hover for ever"
    flight.mission_on = True
    flight.run(2.0)
    assert flight.px4.mode == AUTO_LAND, "the mission does not take it back"


@pytest.mark.slow
def test_set_points_leave_at_once_and_carry_the_feed_forward():
    flight = hovering()
    flight.px4.targets.clear()
    flight.run(1.0)
    assert 48 <= len(flight.px4.targets) <= 52, "one for each of the mission's"
    bridge = flight.bridge
    speed, push = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6])
    bridge.stream.setpoint(
        PositionSetpoint(flight.now, flight.goal, speed, push, 0.2, Phase.HOVER), flight.now
    )
    (target,) = [
        m
        for m in bridge.tick(flight.now + MS).messages
        if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    ]
    # the velocity of 0.2 s later: PX4's attitude is so late
    assert (target.vx, target.vy, target.vz) == pytest.approx((0.3, 0.18, -0.42))
    assert (target.afx, target.afy, target.afz) == pytest.approx((0.5, 0.4, -0.6))


@pytest.mark.slow
def test_a_vehicle_that_was_started_again():
    flight = Flight().run(5.0)
    flight.px4.boot(flight.now)
    flight.run(6.0)
    assert any(key == "vehicle_rebooted" for key, _ in flight.events)
    assert abs(flight.bridge.sync.offset_ns + flight.px4.ahead_ns) < 1 * MS
    assert flight.out.status.ready, flight.out.status.findings


@pytest.mark.slow
def test_parameters_for_a_loss_are_set_with_consent():
    wrong = {"COM_OBL_RC_ACT": 0, "EKF2_BARO_CTRL": 0}
    wrong |= {"COM_DISARM_LAND": -1.0, "COM_LOW_BAT_ACT": 0}
    flight = Flight(px4=wrong).run(6.0)
    assert any("px4_parameters=safe" in text for text in flight.out.status.findings)
    assert not flight.out.status.ready
    assert all(flight.px4.table.get(name) == value for name, value in wrong.items())
    flight = Flight(writes=parse_assignments(["safe"]), px4=wrong)
    flight.run(12.0)
    assert flight.out.status.ready, flight.out.status.findings
    assert flight.px4.table.get("COM_OBL_RC_ACT") == 4


@pytest.mark.slow
def test_a_restart_is_asked_for_where_px4_needs_one():
    wrong = {"EKF2_HGT_REF": 1, "EKF2_EV_CTRL": 0}
    flight = Flight({"EKF2_HGT_REF": 3.0, "EKF2_EV_CTRL": 15.0}, px4=wrong).run(5.0)
    assert flight.out.faults["parameters_at_start"].startswith("EKF2_HGT_REF changed: restart")
    flight = Flight({"EKF2_HGT_REF": 3.0}).run(5.0)
    assert "parameters_at_start" not in flight.out.faults


@pytest.mark.slow
def test_ending_in_flight_it_asks_px4_to_land():
    assert Flight().run(3.0).bridge.shutdown_command() is None
    flight = hovering()
    last = flight.bridge.shutdown_command()
    assert (last.command, last.param2, last.param3) == (176, 4.0, 6.0)
    flight.px4.shows = POSCTL
    flight.run(1.5)
    assert flight.bridge.shutdown_command() is None, "somebody else flies it"


@pytest.mark.slow
def test_a_clock_set_back_in_flight_does_not_end_it():
    flight = hovering()
    # the present position is streamed by the clock
    flight.bridge.session.stage = SessionStage.EXTERNAL_MODE
    flight.set_clock(-3600 * 1000 * MS)
    flight._to_px4.clear(), flight._to_us.clear(), flight._poses.clear()
    flight.px4.targets.clear()
    flight.run(3.0)
    assert len(flight.px4.targets) > 30
    assert flight.px4.mode == OFFBOARD
    assert any(key == "clock_set_back" for key, _ in flight.events)
    assert flight.out.status.connected
    assert abs(flight.bridge.sync.offset_ns + flight.px4.ahead_ns) < 1 * MS


@pytest.mark.slow
@pytest.mark.parametrize("by_s", [-2, 2])
def test_a_clock_that_jumps_in_flight_blinds_nobody(by_s):
    flight = hovering().until(lambda f: not f._to_us)
    flight.set_clock(by_s * 1000 * MS)
    began, seen = flight.now, len(flight.seen["odometry"])
    longest_ns, last_ns, ticks = 0, began, seen
    for _ in range(round(2.0 * 250)):
        flight.step()
        assert flight.px4.mode == OFFBOARD
        assert flight.out.status.stage == SessionStage.FLYING
        if len(flight.seen["odometry"]) > ticks:
            ticks = len(flight.seen["odometry"])
            longest_ns, last_ns = max(longest_ns, flight.now - last_ns), flight.now
    assert longest_ns < 70 * MS, "of 50 Hz"
    for odometry in flight.seen["odometry"][seen:]:
        taken_ns = odometry.boot_ns - flight.px4.ahead_ns
        assert abs(odometry.stamp_ns - taken_ns) < 3 * MS


# --- A loss in flight ----------------------------------------------------------------------------


@pytest.mark.slow
def test_poses_that_stop_in_flight_land_it():
    flight = hovering()
    flight.mocap_on = False
    began = flight.now
    flight.stage(SessionStage.LANDING)
    assert 0.9 < (flight.now - began) * 1e-9 < 1.3
    flight.until(lambda f: f.px4.mode == AUTO_LAND)
    sent = len(flight.px4.targets)
    flight.mocap_on = True
    flight.until(lambda f: not f.px4.armed, 20.0)
    assert len(flight.px4.targets) == sent, "no set point can bring OFFBOARD back"


@pytest.mark.slow
def test_a_pose_that_jumps_in_flight_is_not_sent_and_lands_it():
    flight = hovering()
    sent = flight.bridge.poses_sent
    flight.as_mocap = lambda place, attitude: (place + np.array([1.0, 0.0, 0.0]), attitude)
    flight.stage(SessionStage.LANDING)
    assert flight.bridge.poses_sent <= sent + 1
    assert flight.bridge.poses_refused["jump"] > 5
