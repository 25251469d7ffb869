"""The reaction in line: what goes on to the controller, and when."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_collision.params import ReactionLimits
from tombo_collision.reaction_core import ReactionCore
from tombo_collision.reaction_memory import EventRefusal, HoldReason
from tombo_collision.reactions.bounce import Bounce
from tombo_dynamics.messages import (
    CollisionEvent,
    DetectorStatus,
    Odometry,
    Phase,
    Pose,
    PositionSetpoint,
    ReactionPhase,
    neutral,
)

PHASE_IDLE, TAKEOFF, HOVER, APPROACH, REACT, HOLD, LAND, LANDED = (int(p) for p in list(Phase)[:8])
IDLE, REACTING, BLIND, HOLDING = (int(state) for state in ReactionPhase)
MS = 1_000_000
START = 1_763_700_000_000_000_000
HERE = np.array([1.6, 0.1, 2.0])
X_C = np.array([1.7, 0.1, 2.0])
X_R = np.array([0.9, 0.1, 2.0])


def at(place, phase=APPROACH, velocity=(0.7, 0.0, 0.0)):
    velocity = np.array(velocity, float)
    return PositionSetpoint(0, np.array(place, float), velocity, np.zeros(3), 0.3, phase)


def finite(s):
    return np.isfinite([*s.position, *s.velocity, *s.acceleration, s.yaw]).all()


def collision(x_c=X_C, direction=(1.0, 0.0, 0.0)):
    x_c, direction = np.array(x_c, float), np.array(direction, float)
    return CollisionEvent(0, "map", 2, 0, x_c, direction, 1.0, 100.0, 1)


class Bench:
    """Runs the core at 250 Hz with the inputs that are switched on, and keeps its messages."""

    def __init__(self, phase=APPROACH, place=HERE):
        self.now = START
        self.mission_setpoint = at(place, phase)
        self.place = np.array(place, float)
        self.mission = self.odometry = self.mocap = self.detector = True
        self.published = []
        self.restart()
        self.run(0.2)

    def restart(self):
        self.core = ReactionCore(Bounce(), ReactionLimits())
        self.last_from_mission = None
        self.statuses = []

    def tell(self, setpoint):
        accepted = self.core.take("/mission/setpoint", setpoint, self.now)
        self.last_from_mission = setpoint if accepted else self.last_from_mission
        return accepted

    def estimate(self, place):
        estimate = replace(neutral(Odometry, self.now), position=np.array(place, float))
        return self.core.take("/odometry", estimate, self.now)

    def crowd(self, several):
        self.core.set_multiple_publishers("/mission/setpoint", several)

    def run(self, seconds):
        """Return the messages of that time."""
        before = len(self.published)
        for _ in range(round(seconds * 250)):
            self.now += 4 * MS
            tick = (self.now - START) // (4 * MS)
            if self.mocap and tick % 8 == 0:
                self.core.on("/mocap/pose", neutral(Pose, self.now), self.now)
            if self.mocap and self.detector and tick % 8 == 1:
                self.core.on("/detector/status", neutral(DetectorStatus, self.now), self.now)
            if self.odometry:
                self.estimate(self.place)
            if self.mission and tick % 5 == 0:
                self.tell(self.mission_setpoint)
            self.tick()
        return [s for _, s in self.published[before:]]

    def tick(self):
        """Return the set point; the mission's own where it is that, unchanged."""
        published = dict(self.core.step(self.now))
        if "/reaction/status" in published:
            self.statuses.append(published["/reaction/status"])
        setpoint, told = published.get("/setpoint"), self.last_from_mission
        if setpoint is None:
            return None
        assert setpoint.stamp_ns == self.now
        moves = ("position", "velocity", "acceleration", "yaw", "phase")
        if told and all(np.array_equal(getattr(setpoint, n), getattr(told, n)) for n in moves):
            setpoint = told
        self.published.append((self.now, setpoint))
        return setpoint

    def hit(self, event=None, age_ms=20):
        event = replace(event or collision(), stamp_ns=self.now - age_ms * MS)
        return self.core.event(event, self.now)

    @property
    def status(self):
        return self.statuses[-1]

    @property
    def state(self):
        return self.status.state


def only(setpoints):
    """The one place and phase that all set points agree on."""
    ((place, phase),) = {(tuple(s.position), s.phase) for s in setpoints}
    return np.array(place), phase


@pytest.mark.parametrize("phase", range(8))
def test_without_a_collision_the_mission_s_set_point_goes_on_unchanged(phase):
    bench = Bench(phase)
    published = bench.run(1.0)
    assert len(published) == 50
    assert all(s is bench.mission_setpoint for s in published)
    assert bench.state == IDLE


@pytest.mark.parametrize("phase", [TAKEOFF, HOVER, APPROACH])
def test_a_collision_is_answered_in_the_same_run(phase):
    bench = Bench(phase)
    assert bench.hit() == EventRefusal.NONE
    published = bench.tick()
    assert published.position == pytest.approx(X_R)
    assert published.phase == REACT
    assert not published.velocity.any() and not published.acceleration.any()
    assert published.yaw == bench.mission_setpoint.yaw
    assert bench.state == REACTING
    assert bench.status.collisions == 1


def test_it_holds_x_r_until_the_mission_flies_there_itself():
    bench = Bench()
    bench.hit()
    bench.tick()
    place, phase = only(bench.run(1.0))
    assert place == pytest.approx(X_R) and phase == REACT
    bench.mission_setpoint = at(X_R, REACT, (0, 0, 0))
    assert bench.run(0.1)[-1] is bench.mission_setpoint
    for phase in (HOLD, LAND, LANDED):
        bench.mission_setpoint = at(X_R - [0.0, 0.0, 0.1], phase)
        assert bench.run(0.1)[-1] is bench.mission_setpoint
        assert bench.state == (IDLE if phase == LANDED else REACTING)
    assert bench.status.collisions == 1


def test_a_second_collision_overrides_the_mission_until_it_knows():
    bench = Bench()
    bench.hit()
    bench.mission_setpoint = at(X_R, HOLD, (0, 0, 0))
    bench.run(0.5)
    bench.hit(collision(X_R, (0.0, 1.0, 0.0)))
    published = bench.tick()
    assert published.position == pytest.approx([0.9, -0.7, 2.0])
    assert bench.status.collisions == 2
    place, _ = only(bench.run(0.5))  # the mission still holds the first x_r
    assert place == pytest.approx([0.9, -0.7, 2.0])
    bench.mission_setpoint = at(place, REACT, (0, 0, 0))
    assert bench.run(0.1)[-1] is bench.mission_setpoint


def test_once_landed_the_next_flight_begins_afresh():
    bench = Bench()
    bench.hit()
    bench.mission_setpoint = at([0, 0, 0.18], LANDED)
    bench.run(0.1)
    bench.mission_setpoint = at([0, 0, 0.18], PHASE_IDLE)
    published = bench.run(0.1)
    assert published[-1] is bench.mission_setpoint
    assert bench.status.collisions == 0


@pytest.mark.parametrize(
    ("why", "event", "age_ms"),
    [
        (EventRefusal.NOT_FINITE, collision([math.nan, 0, 2]), 20),
        (EventRefusal.NOT_UNIT, collision(direction=(0.8, 0, 0)), 20),
        (EventRefusal.NOT_UNIT, collision(direction=(1.2, 0, 0)), 20),
        (EventRefusal.STALE, collision(), 1001),
        (EventRefusal.FUTURE, collision(), -51),
        (EventRefusal.ELSEWHERE, collision([1000.0, 0.0, 2.0]), 20),
    ],
)
def test_an_event_that_makes_no_sense_changes_nothing(why, event, age_ms):
    bench = Bench()
    assert bench.hit(event, age_ms) == why
    published = bench.run(0.2)
    assert all(s is bench.mission_setpoint for s in published)
    assert bench.state == IDLE
    assert bench.hit() == EventRefusal.NONE  # and the next is answered


@pytest.mark.parametrize("phase", [PHASE_IDLE, LAND, LANDED])
def test_on_the_ground_and_landing_there_is_no_reaction(phase):
    bench = Bench(phase)
    assert bench.hit() == EventRefusal.NOT_FLYING
    assert all(s is bench.mission_setpoint for s in bench.run(0.2))


def test_the_same_event_again_is_not_a_second_collision():
    bench = Bench()
    assert [bench.hit(), bench.hit()] == [EventRefusal.NONE, EventRefusal.DUPLICATE]
    bench.run(0.1)
    assert bench.status.collisions == 1


def test_started_in_flight_a_fresh_event_waits_for_the_mission():
    fresh = Bench()
    fresh.restart()
    assert fresh.hit() == EventRefusal.WAITS
    assert fresh.tick() is None
    fresh.tell(fresh.mission_setpoint)
    assert fresh.tick().position == pytest.approx(X_R)


def detector_is_silent(bench):
    bench.detector = False


def mission_is_silent(bench):
    bench.mission = False


def two_missions_speak(bench):
    bench.crowd(True)


@pytest.mark.parametrize(
    ("fails", "why", "phase", "after_s"),
    [
        (detector_is_silent, HoldReason.DETECTOR_SILENT, APPROACH, 0.5),
        *((mission_is_silent, HoldReason.MISSION_SILENT, phase, 0.3)
          for phase in (TAKEOFF, APPROACH, LAND)),
        (two_missions_speak, HoldReason.TWO_PUBLISHERS, APPROACH, 0.0),
    ],
)  # fmt: skip
def test_it_holds_where_it_is_while_something_fails_and_goes_on_after(fails, why, phase, after_s):
    bench = Bench(phase)
    fails(bench)
    published = bench.run(max(after_s - 0.06, 0.0))
    assert all(s is bench.mission_setpoint for s in published)
    bench.run(0.1)
    assert (bench.state, bench.core.memory.why) == (HOLDING, why)
    bench.place = HERE + np.array([0.4, 0.0, 0.0])  # it brakes; where it was is where it stays
    bench.mission_setpoint = at([3.0, 0.0, 2.0], phase)
    place, held_phase = only(bench.run(1.0))
    assert place == pytest.approx(HERE) and held_phase == HOLD
    assert not bench.published[-1][1].velocity.any()
    assert set(np.diff([when for when, _ in bench.published][-20:])) == {20 * MS}
    bench.mission = bench.detector = True
    bench.crowd(False)
    bench.run(0.06)
    assert bench.state == IDLE
    assert bench.run(0.1)[-1] is bench.mission_setpoint


def test_without_a_detector_nobody_takes_off():
    bench = Bench(PHASE_IDLE)
    bench.detector = False
    published = bench.run(1.0)
    assert all(s is bench.mission_setpoint for s in published)
    assert (bench.state, bench.core.memory.why) == (HOLDING, HoldReason.DETECTOR_SILENT)


def test_a_detector_without_poses_is_not_to_blame():
    bench = Bench()
    bench.mocap = False
    bench.run(1.0)
    assert bench.state == BLIND
    assert bench.run(0.1)[-1] is bench.mission_setpoint
    bench.mocap = True
    states = set()
    for _ in range(100):
        bench.run(0.004)
        states.add(bench.state)
    assert HOLDING not in states
    assert bench.state == IDLE


@pytest.mark.parametrize("missing", ["mocap", "odometry"])
def test_flying_blind_is_said_and_x_r_is_kept(missing):
    bench = Bench()
    bench.hit()
    bench.run(0.1)
    setattr(bench, missing, False)
    bench.run(0.2)
    assert bench.state == REACTING
    place, phase = only(bench.run(0.2))
    assert bench.state == BLIND
    assert place == pytest.approx(X_R) and phase == REACT
    assert bench.status.x_r == pytest.approx(X_R)
    setattr(bench, missing, True)
    bench.run(0.05)
    assert bench.state == REACTING


@pytest.mark.parametrize("fails", [mission_is_silent, two_missions_speak])
@pytest.mark.parametrize("phase", [APPROACH, REACT, HOLD])
def test_a_mission_that_fails_after_a_collision_leaves_it_at_x_r(phase, fails):
    bench = Bench()
    bench.hit()
    bench.tick()
    bench.mission_setpoint = at(X_R, phase, (0, 0, 0))
    bench.run(0.2)
    fails(bench)
    bench.mission_setpoint = at([5.0, 5.0, 5.0], HOLD)
    bench.place = X_C + np.array([0.1, 0.1, -0.5])
    bench.run(0.4)
    place, held_phase = only(bench.run(0.5))
    assert place == pytest.approx(X_R) and held_phase == REACT


def test_a_mission_that_dies_while_landing_leaves_it_hovering():
    bench = Bench()
    bench.hit()
    bench.mission_setpoint = at(X_R, LAND)
    bench.run(0.2)
    bench.place = X_R - [0.0, 0.0, 0.7]
    bench.mission = False
    bench.run(0.4)
    place, phase = only(bench.run(0.5))
    assert place == pytest.approx(bench.place) and phase == HOLD


anything = st.sampled_from([math.nan, math.inf, -math.inf])


@given(st.sampled_from(["position", "velocity", "acceleration", "yaw"]), anything)
def test_a_set_point_that_is_no_number_is_refused_and_counts_as_silence(name, value):
    bench = Bench()
    good = bench.mission_setpoint
    bad = value if name == "yaw" else np.array([0.0, value, 0.0])
    bench.mission_setpoint = replace(good, **{name: bad})
    assert not bench.tell(bench.mission_setpoint)
    published = bench.run(0.6)
    assert all(finite(s) for s in published)
    assert (bench.state, bench.core.memory.why) == (HOLDING, HoldReason.MISSION_SILENT)


def test_a_clock_set_back_begins_again_and_nobody_seems_alive():
    bench = Bench()
    bench.hit()
    bench.run(0.1)
    bench.now -= 1000 * MS * 1000
    bench.mission_setpoint = at([0.0, 0.0, 0.18], PHASE_IDLE)
    assert bench.run(0.2)[-1] is bench.mission_setpoint
    assert bench.state == IDLE
    assert bench.status.collisions == 0
    bench.now -= 1000 * MS * 1000
    bench.detector = False
    bench.run(0.6)
    assert (bench.state, bench.core.memory.why) == (HOLDING, HoldReason.DETECTOR_SILENT)


inputs = st.lists(
    st.tuples(
        st.sampled_from(["mission", "odometry", "mocap", "detector"]),
        st.booleans(),
        st.floats(0.01, 0.7),
    ),
    max_size=12,
)


@pytest.mark.slow
@given(inputs, st.integers(0, 12))
def test_a_valid_setpoint_comes_at_50_hz_whichever_input_is_silent(changes, when):
    """In the air: no gap beyond the mission's timeout, no jump but to where it is or to x_r."""
    bench = Bench()
    for k, (name, alive, seconds) in enumerate(changes):
        if k == when:
            bench.hit()
        setattr(bench, name, alive)
        bench.run(seconds)
    times = np.array([when for when, _ in bench.published])
    assert np.diff(times).max(initial=0) <= 330 * MS
    for _, published in bench.published:
        assert finite(published)
        places = (bench.mission_setpoint.position, HERE, X_R)
        assert min(np.linalg.norm(published.position - p) for p in places) < 1e-9
        assert published.phase in (APPROACH, REACT, HOLD)
