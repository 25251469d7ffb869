"""When the bridge streams, arms, asks for modes and lands, against a scripted vehicle."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20.common import MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_SET_MODE

from tombo_dynamics.messages import Phase
from tombo_px4.bridge.session import (
    BridgeOutput,
    Session,
    SessionInput,
    SessionStage,
    SetpointSource,
    VehicleCommand,
)
from tombo_px4.link.messages import CommandAck, Heartbeat, StatusText
from tombo_px4.modes import (
    ALTCTL,
    AUTO_HOLD,
    AUTO_LAND,
    AUTO_RTL,
    AUTO_TAKEOFF,
    OFFBOARD,
    POSCTL,
    STABILIZED,
    MavLandedState,
)

STEP = 20_000_000
SECOND = 1_000_000_000
REJECTED, DENIED = 1, 2


class Vehicle:
    """PX4 as far as heartbeats and commands go; `refuses` makes it say no."""

    def __init__(self):
        self.armed, self.mode, self.landed = False, AUTO_HOLD, MavLandedState.ON_GROUND
        self.refuses: dict[int, int] = {}
        self.refused_modes = set()
        self.deaf = self.silent = self.failsafe = self.killed = False
        self.arms_late_ns = 0
        self.received = []
        self.heartbeat = None
        self._arm_at = None

    def command(self, order, now, session):
        self.received.append(order)
        if self.deaf:
            return
        refused = order.mode in self.refused_modes
        result = REJECTED if refused else self.refuses.get(order.command, 0)
        if order.mode is not None:  # the MAVLink module's own, which says nothing
            session.handle_ack(CommandAck(now, MAV_CMD_DO_SET_MODE, 0))
        session.handle_ack(CommandAck(now, order.command, result))
        if result:
            session.recent_texts.take(
                StatusText(now, 2, "Arming denied: Resolve system health failures first")
            )
        elif order.mode is not None:
            self.mode = order.mode
        elif order.armed and self.arms_late_ns:
            self._arm_at = now + self.arms_late_ns
        else:
            self.armed = bool(order.armed)

    def beat(self, now):
        if self._arm_at is not None and now >= self._arm_at:
            self.armed, self._arm_at = True, None
        if not self.silent:
            self.heartbeat = Heartbeat(now, self.armed, self.mode, self.failsafe, self.killed)


class Flight:
    """A session, a vehicle and a mission, 50 times a second."""

    def __init__(self, phase=Phase.IDLE):
        self.session, self.vehicle = Session(1.5), Vehicle()
        self.now = SECOND
        self.phase, self.fresh, self.streaming, self.blockers = phase, True, True, ()
        self.takeoff_commands = 0
        self.must_land = ""
        self.poses_wrong = self.touched = False
        self.events, self.replies, self.faults = [], [], {}
        self.stream = None
        self._beat = 0

    def step(self):
        self.now += STEP
        if self.now - self._beat >= SECOND:
            self._beat = self.now
            self.vehicle.beat(self.now)
        view = SessionInput(
            self.now,
            self.vehicle.heartbeat,
            self.vehicle.landed,
            self.phase,
            self.fresh,
            self.streaming,
            self.blockers,
            self.must_land,
            takeoff_commands=self.takeoff_commands,
            poses_wrong=self.poses_wrong,
            touched=self.touched,
        )
        out = BridgeOutput()
        self.session.tick(view, out)
        for order in out.vehicle_commands:
            self.vehicle.command(order, self.now, self.session)
        self.events += out.events
        self.replies += out.replies
        self.faults, self.stream = out.faults, out.stream

    def run(self, seconds):
        for _ in range(round(seconds * 50)):
            self.step()
        return self

    def until(self, stage, phase=None):
        """Go on, by another phase if there is one, at most for 12 s."""
        self.phase = self.phase if phase is None else phase
        for _ in range(12 * 50):
            self.step()
            if self.session.stage == stage:
                return self
        raise AssertionError(f"stays {self.session.stage}: {self.session.why}")

    def take_off(self):
        self.run(2.5)
        self.until(SessionStage.FLYING, Phase.TAKEOFF)
        self.vehicle.landed = MavLandedState.IN_AIR
        self.phase = Phase.HOVER
        return self.run(1.0)

    def ask(self, kind):
        self.session.request(kind)
        for _ in range(50 * 15):
            self.step()
            if self.replies:
                return self.replies[-1]
        raise AssertionError(f"no answer to {kind}")

    def modes_asked(self):
        return [o.mode for o in self.vehicle.received if o.mode is not None]

    def armings(self):
        return [o.armed for o in self.vehicle.received if o.armed is not None]


def test_a_flight_arms_in_offboard_and_lands_by_px4():
    flight = Flight().run(5.0)
    assert (flight.session.stage, flight.stream) == (SessionStage.READY, SetpointSource.PRESENT)
    assert not flight.vehicle.received, "on the ground nothing is asked for"
    flight.until(SessionStage.FLYING, Phase.TAKEOFF)
    assert [str(o) for o in flight.vehicle.received] == ["mode offboard", "arming"]
    flight.run(0.1)
    assert flight.stream == SetpointSource.SETPOINT
    flight.vehicle.landed, flight.phase = MavLandedState.IN_AIR, Phase.HOVER
    flight.run(10.0)
    flight.until(SessionStage.LANDING, Phase.LAND).run(2.0)
    assert flight.modes_asked() == [OFFBOARD, AUTO_LAND]
    flight.vehicle.landed, flight.vehicle.armed = MavLandedState.ON_GROUND, False
    flight.until(SessionStage.READY)
    flight.phase = Phase.LANDED
    flight.run(10.0)
    assert flight.session.stage == SessionStage.READY
    assert flight.armings() == [True]
    assert not flight.events


def test_after_a_flight_a_restarted_mission_arms_nothing_without_a_command():
    flight = Flight().take_off()
    flight.until(SessionStage.LANDING, Phase.LAND)
    flight.vehicle.landed, flight.vehicle.armed = MavLandedState.ON_GROUND, False
    flight.until(SessionStage.READY, Phase.IDLE).run(2.0)
    flight.phase = Phase.TAKEOFF
    flight.run(5.0)
    assert flight.armings() == [True]
    assert "/mission/takeoff" in flight.faults["not_engaged"]
    flight.phase, flight.takeoff_commands = Phase.IDLE, 1
    flight.run(1.0)
    flight.until(SessionStage.FLYING, Phase.TAKEOFF)
    assert flight.armings() == [True, True]


def test_px4_has_seen_the_stream_for_a_second_before_offboard():
    flight = Flight()
    flight.streaming = False
    flight.run(3.0)
    flight.phase, flight.streaming = Phase.TAKEOFF, True
    flight.run(0.9)
    assert not flight.vehicle.received
    flight.run(0.2)
    assert flight.modes_asked() == [OFFBOARD]


@pytest.mark.parametrize("blockers", [("stamps are 1.2 s in the future",), ("a", "b")])
def test_what_the_checks_forbid_is_not_armed_and_reported(blockers):
    flight = Flight().run(2.0)
    flight.blockers, flight.phase = blockers, Phase.TAKEOFF
    flight.run(5.0)
    assert not flight.vehicle.received
    assert all(text in flight.faults["preflight"] for text in blockers)
    flight.blockers = ()
    flight.until(SessionStage.FLYING)
    assert not flight.faults


def test_a_refused_arming_is_retried_reported_and_given_up():
    flight = Flight().run(2.0)
    flight.vehicle.refuses[MAV_CMD_COMPONENT_ARM_DISARM] = REJECTED
    flight.until(SessionStage.GIVEN_UP, Phase.TAKEOFF)
    assert flight.armings() == 5 * [True]
    text = flight.faults["given_up"]
    assert "arming temporarily rejected" in text
    assert "Resolve system health failures first" in text
    assert all("Resolve" in text for _, text in flight.events)
    flight.run(20.0)
    assert flight.armings() == 5 * [True], "bounded"


def test_a_mode_lost_while_arming_disarms_what_arms_late():
    flight = Flight().run(2.0)
    flight.vehicle.arms_late_ns = 1_500_000_000
    flight.until(SessionStage.ARMING, Phase.TAKEOFF).run(0.3)
    flight.vehicle.mode = POSCTL
    flight.until(SessionStage.GIVEN_UP)
    assert "mode changed to position while arming" in flight.session.why
    flight.vehicle.arms_late_ns = 0
    flight.run(4.0)
    assert not flight.vehicle.armed
    assert flight.armings()[-1] is False
    assert any("disarmed again" in text for _, text in flight.events)
    assert flight.session.stage == SessionStage.GIVEN_UP


def test_a_mode_taken_by_somebody_else_is_reported_and_never_fought():
    flight = Flight().take_off()
    flight.vehicle.mode = POSCTL
    asked = len(flight.vehicle.received)
    flight.session.recent_texts.take(StatusText(flight.now, 4, "Pilot took over using sticks"))
    flight.until(SessionStage.EXTERNAL_MODE).run(20.0)
    assert len(flight.vehicle.received) == asked
    assert flight.stream == SetpointSource.PRESENT
    text = flight.faults["mode_taken"]
    assert "mode is position" in text and "Pilot took over" in text and "px4/offboard" in text
    flight.vehicle.mode = OFFBOARD  # even then: it waits to be asked
    flight.run(2.0)
    assert flight.stream == SetpointSource.HOLD
    flight.vehicle.mode = POSCTL
    reply = flight.ask("offboard")
    assert reply.success and flight.vehicle.mode == OFFBOARD
    assert flight.run(0.1).stream == SetpointSource.SETPOINT
    assert "mode_taken" not in flight.faults


def test_a_lost_link_is_reported_and_nothing_is_armed_on_return():
    flight = Flight().take_off()
    flight.vehicle.silent = True
    flight.run(1.3)
    assert flight.session.stage == SessionStage.FLYING
    flight.run(1.5)
    assert flight.session.stage == SessionStage.LINK_LOST
    assert "nothing is armed" in flight.faults["link_lost"]
    assert flight.stream == SetpointSource.NONE, "PX4 must not come back to OFFBOARD by itself"
    flight.vehicle.silent, flight.vehicle.armed = False, False
    flight.vehicle.landed = MavLandedState.ON_GROUND
    asked = len(flight.vehicle.received)
    flight.run(10.0)
    assert len(flight.vehicle.received) == asked
    assert "disarmed while the link was lost" in flight.faults["given_up"]


@pytest.mark.parametrize(
    ("mode", "failsafe", "stage"),
    [
        (OFFBOARD, False, SessionStage.LANDING),
        (AUTO_LAND, True, SessionStage.LANDING),
        (AUTO_RTL, False, SessionStage.EXTERNAL_MODE),
    ],
)
def test_a_link_that_returns_in_flight(mode, failsafe, stage):
    flight = Flight().take_off()
    flight.vehicle.silent = True
    flight.run(4.0)
    flight.vehicle.silent, flight.vehicle.mode = False, mode
    flight.vehicle.failsafe = failsafe
    flight.run(1.5)
    assert flight.session.stage == stage
    assert "link_lost" not in flight.faults
    landed = stage == SessionStage.LANDING
    assert (flight.modes_asked()[-1] == AUTO_LAND) == landed
    assert (flight.stream == SetpointSource.NONE) == landed


@pytest.mark.parametrize("mode", [AUTO_LAND, ALTCTL, STABILIZED, AUTO_RTL, POSCTL])
def test_px4s_own_fail_safe_is_no_pilot(mode):
    """It is landed and disarmed, and gets no set point with which it could return."""
    flight = Flight().take_off()
    flight.vehicle.mode, flight.vehicle.failsafe = mode, True
    flight.until(SessionStage.LANDING).run(3.0)
    assert flight.modes_asked()[-1] == AUTO_LAND
    flight.vehicle.mode, flight.vehicle.failsafe = OFFBOARD, False  # all is back
    for _ in range(20):
        flight.run(0.5)
        assert flight.stream == SetpointSource.NONE or flight.vehicle.mode == AUTO_LAND
    assert (flight.session.stage, flight.vehicle.mode) == (SessionStage.LANDING, AUTO_LAND)
    flight.vehicle.landed = MavLandedState.ON_GROUND
    flight.run(6.0)
    assert not flight.vehicle.armed
    flight.run(20.0)
    assert flight.armings() == [True, False] and "not_engaged" in flight.faults
    flight.phase, flight.takeoff_commands = Phase.IDLE, 1
    flight.run(2.0).until(SessionStage.FLYING, Phase.TAKEOFF)
    assert flight.vehicle.armed, "an operator's new take-off flies"


def test_a_landing_that_px4_refuses_is_commanded_until_it_lands():
    flight = Flight().take_off()
    flight.vehicle.refused_modes = {AUTO_LAND}
    flight.must_land = "no mocap pose for 1.0 s"
    flight.until(SessionStage.LANDING).run(30.0)
    assert flight.stream == SetpointSource.NONE and flight.session.stage == SessionStage.LANDING
    flight.vehicle.refused_modes = set()
    flight.run(5.0)
    assert flight.vehicle.mode == AUTO_LAND


@pytest.mark.parametrize("kind", ["hold", "takeoff"])
def test_what_must_land_lands_out_of_an_operators_mode_too(kind):
    flight = Flight()
    if kind == "hold":
        flight.take_off()
    else:
        flight.run(2.0)
    assert flight.ask(kind).success
    flight.vehicle.landed = MavLandedState.IN_AIR
    flight.must_land = "no mocap pose for 1.0 s"
    flight.until(SessionStage.LANDING).run(2.0)
    assert flight.vehicle.mode == AUTO_LAND
    assert not flight.ask("offboard").success


def test_what_must_land_leaves_a_pilots_mode_alone():
    flight = Flight().take_off()
    flight.vehicle.mode = POSCTL
    flight.until(SessionStage.EXTERNAL_MODE)
    asked, flight.must_land = len(flight.vehicle.received), "no mocap pose for 1.0 s"
    flight.run(10.0)
    assert len(flight.vehicle.received) == asked


def test_a_bridge_that_was_stopped_in_flight_lands():
    flight = Flight().take_off()
    flight.now += 20 * SECOND
    flight.vehicle.beat(flight.now)
    flight.until(SessionStage.LANDING).run(2.0)
    assert flight.vehicle.mode == AUTO_LAND and flight.stream == SetpointSource.NONE


def test_a_bridge_that_finds_offboard_lands_it():
    """A bridge before it has flown there, and nobody else will bring it down."""
    flight = Flight(Phase.HOVER)
    flight.vehicle.armed, flight.vehicle.mode = True, OFFBOARD
    flight.vehicle.landed = MavLandedState.IN_AIR
    flight.run(5.0)
    assert (flight.session.stage, flight.vehicle.mode) == (SessionStage.LANDING, AUTO_LAND)


def test_a_bridge_started_in_flight_touches_nothing():
    flight = Flight(Phase.HOVER)
    flight.vehicle.armed, flight.vehicle.mode = True, AUTO_RTL
    flight.vehicle.landed = MavLandedState.IN_AIR
    flight.run(10.0)
    assert (flight.session.stage, flight.vehicle.received) == (SessionStage.EXTERNAL_MODE, [])
    flight.vehicle.armed, flight.vehicle.landed = False, MavLandedState.ON_GROUND
    flight.run(10.0)
    assert not flight.vehicle.received, "the mission still hovers: that is no order to take off"
    assert "start it again" in flight.faults["not_engaged"]


def test_a_refused_landing_goes_on_in_offboard_and_disarms_on_the_ground():
    flight = Flight().take_off()
    flight.vehicle.refuses[MAV_CMD_DO_SET_MODE] = REJECTED
    flight.until(SessionStage.LANDING, Phase.LAND).run(6.0)
    assert flight.session.stage == SessionStage.LANDING
    assert flight.stream == SetpointSource.SETPOINT
    flight.vehicle.landed, flight.phase = MavLandedState.ON_GROUND, Phase.LANDED
    flight.until(SessionStage.READY)
    assert flight.armings() == [True, False]


def test_disarmed_in_flight_is_not_armed_again():
    flight = Flight().take_off()
    flight.vehicle.armed = False
    flight.session.recent_texts.take(
        StatusText(flight.now, 1, "Critical failure detected: terminate")
    )
    flight.until(SessionStage.GIVEN_UP).run(10.0)
    assert "Critical failure" in flight.session.why
    assert flight.armings() == [True]


# --- the operator ------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [OFFBOARD, POSCTL])
def test_kill_disarms_in_the_air_by_force_whoever_flies(mode):
    flight = Flight().take_off()
    flight.vehicle.mode = mode
    flight.run(1.5)
    began = flight.now
    assert flight.ask("kill").success
    assert flight.now - began < 2 * SECOND
    assert flight.vehicle.received[-1] == VehicleCommand(armed=False, force=True)
    flight.run(20.0)
    assert not flight.vehicle.armed, "the mission still wants to fly: nothing arms again"


def test_kill_is_sent_without_a_link_too():
    flight = Flight().take_off()
    flight.vehicle.silent = True
    flight.until(SessionStage.LINK_LOST)
    reply = flight.ask("kill")
    assert not reply.success and "no heartbeat" in reply.text
    assert flight.vehicle.received[-1] == VehicleCommand(armed=False, force=True)


def test_a_hold_that_px4_refuses_is_one_by_set_points():
    flight = Flight().take_off()
    flight.vehicle.refused_modes = {AUTO_HOLD}
    reply = flight.ask("hold")
    assert reply.success and "set points hold it" in reply.text
    assert (flight.session.stage, flight.vehicle.mode) == (SessionStage.EXTERNAL_MODE, OFFBOARD)
    assert flight.run(20.0).stream == SetpointSource.HOLD, "the mission is not followed"
    flight.replies.clear()
    assert flight.ask("offboard").success
    assert flight.run(0.1).stream == SetpointSource.SETPOINT


# --- whatever happens --------------------------------------------------------------------------

ON_THE_GROUND = (Phase.IDLE, Phase.LANDED, Phase.LAND, Phase.DESCEND_BLIND)
"""Phases in which nothing is armed."""
HAPPENINGS = st.one_of(
    st.tuples(st.just(what), st.sampled_from(values))
    for what, values in {
        "phase": [*ON_THE_GROUND, Phase.TAKEOFF, Phase.HOVER],
        "mode": [OFFBOARD, AUTO_HOLD, POSCTL, AUTO_RTL],
        **dict.fromkeys(("armed", "silent", "deaf", "fresh", "streaming"), (False, True)),
        "landed": list(MavLandedState),
        "refuse": [0, 1, 2, 4],
        "blockers": [(), ("x",)],
        "ask": ["arm", "disarm", "land", "hold", "offboard"],
    }.items()
)


@pytest.mark.slow
@settings(max_examples=60)
@given(st.lists(st.tuples(HAPPENINGS, st.floats(0.02, 3.0)), max_size=14))
def test_whatever_happens_the_rules_hold(story):
    """Every wish is answered; nothing is armed against the checks or in a pilot's mode."""
    flight = Flight()
    asked = 0
    for (what, value), seconds in story:
        if what in ("mode", "armed", "landed", "silent", "deaf"):
            setattr(flight.vehicle, what, value)
        elif what == "refuse":
            flight.vehicle.refuses = dict.fromkeys(
                (MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_SET_MODE), value
            )
        elif what == "ask":
            asked += 1
            flight.session.request(value)
        else:
            setattr(flight, what, value)
        for _ in range(max(1, round(seconds * 50))):
            before = len(flight.vehicle.received)
            flight.step()
            heard = flight.vehicle.heartbeat
            sent = flight.vehicle.received[before:]
            assert len(sent) <= 2
            for order in sent:
                assert heard is not None, "nothing is sent to nobody"
                if order.armed and not asked:
                    assert flight.vehicle.heartbeat.mode == OFFBOARD
                    assert not flight.blockers
                    assert flight.phase not in ON_THE_GROUND
    flight.run(8.0)
    assert sorted(r.number for r in flight.replies) == list(range(1, asked + 1))


# --- a descent by thrust -------------------------------------------------------------------------


def test_wrong_poses_end_a_flight_by_thrust_and_the_rotors_stop_on_the_ground():
    flight = Flight().take_off()
    flight.must_land, flight.poses_wrong = "poses of another body", True
    flight.until(SessionStage.LANDING).run(3.0)
    assert flight.stream == SetpointSource.LEVEL_DESCENT
    assert flight.vehicle.mode == OFFBOARD and AUTO_LAND not in flight.modes_asked()
    flight.touched = True
    flight.until(SessionStage.READY)
    assert flight.vehicle.received[-1] == VehicleCommand(armed=False, force=True)


@pytest.mark.parametrize("mode", [AUTO_TAKEOFF, AUTO_LAND])
def test_wrong_poses_end_modes_of_px4_that_the_operator_has_asked_for(mode):
    flight = Flight().run(2.5)
    assert flight.ask("takeoff").success
    flight.vehicle.landed = MavLandedState.IN_AIR
    flight.run(1.0)
    flight.vehicle.mode = mode
    if mode == AUTO_LAND:
        flight.replies.clear()
        assert flight.ask("land").success
    flight.must_land, flight.poses_wrong = "poses of another body", True
    flight.run(4.0)
    assert flight.vehicle.mode == OFFBOARD and flight.stream == SetpointSource.LEVEL_DESCENT


def test_poses_that_turn_out_wrong_during_a_landing_turn_it_into_a_descent_by_thrust():
    flight = Flight().take_off()
    flight.must_land = "no mocap pose for 1.0 s"
    flight.until(SessionStage.LANDING).run(2.0)
    assert flight.vehicle.mode == AUTO_LAND
    flight.poses_wrong = True
    flight.run(3.0)
    assert flight.vehicle.mode == OFFBOARD and flight.stream == SetpointSource.LEVEL_DESCENT


# --- services in every state ---------------------------------------------------------------------


STATES = {
    # state: takes off, asked service, then changes of the flight and of the vehicle, and [s]
    "ground": (False, "", {}, {}, 0.0),
    "blocked": (False, "", {"blockers": ("axes are not proven",)}, {}, 1.0),
    "armed": (False, "arm", {}, {}, 0.0),
    "flies": (True, "", {}, {}, 0.0),
    "holds": (True, "hold", {}, {}, 0.0),
    "lands": (True, "land", {}, {}, 0.0),
    "landed": (True, "land", {}, {"landed": MavLandedState.ON_GROUND}, 0.5),
    "lost": (True, "", {"must_land": "no mocap pose for 1.0 s"}, {}, 0.1),
    "pilot": (True, "", {}, {"mode": POSCTL}, 2.0),
    "killed": (True, "kill", {}, {}, 0.0),
    "no link": (True, "", {}, {"silent": True}, 3.0),
}
ANSWERS = {
    # service: states in which it is obeyed; in all others it is refused with a reason
    "arm": {"ground", "armed", "flies", "holds", "lands", "landed", "lost", "pilot", "killed"},
    "disarm": set(STATES) - {"no link"},
    "takeoff": {"ground", "killed"},
    "land": {"armed", "flies", "holds", "lands", "landed", "lost", "pilot"},
    "hold": {"flies", "holds", "lands", "pilot"},
    "offboard": {"ground", "blocked", "armed", "flies", "holds", "lands", "landed", "pilot",
                 "killed"},
    "kill": set(STATES) - {"no link"},
}  # fmt: skip
"""PX4 itself decides on a disarming in the air."""
SHOWS = {
    "arm": lambda v: v.armed,
    "disarm": lambda v: not v.armed,
    "takeoff": lambda v: v.armed and v.mode == AUTO_TAKEOFF,
    "land": lambda v: v.mode == AUTO_LAND,
    "hold": lambda v: v.armed and v.mode in (AUTO_HOLD, OFFBOARD),
    "offboard": lambda v: v.mode == OFFBOARD,
    "kill": lambda v: not v.armed,
}


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("service", ANSWERS)
def test_a_service_is_obeyed_or_refused_with_a_reason_in_every_state(service, state):
    takes_off, asked, changes, of_vehicle, seconds = STATES[state]
    flight = Flight()
    flight.take_off() if takes_off else flight.run(2.5)
    assert not asked or flight.ask(asked).success
    vars(flight).update(changes)
    vars(flight.vehicle).update(of_vehicle)
    flight.run(seconds)
    flight.replies.clear()
    reply = flight.ask(service)
    assert reply.success == (state in ANSWERS[service]), reply.text
    assert reply.text
    if reply.success:
        assert SHOWS[service](flight.vehicle)
    elif state == "blocked" and service in ("arm", "takeoff"):
        assert reply.text == flight.blockers[0] and not flight.vehicle.received
