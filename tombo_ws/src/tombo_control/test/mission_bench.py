"""Flights of the mission's tests: its core at 50 Hz, and a vehicle that follows it."""

import math

import numpy as np

from core_calls import Mission
from tombo_control.planning.leg import leg_position, leg_yaw
from tombo_control.planning.mission import MissionParams, advance_mission, begin, compiled_plan
from tombo_control.planning.mission_memory import MissionLimits, MissionMemory
from tombo_dynamics.messages import Phase

MS = 1_000_000
START = 1_763_700_000_000_000_000
PLAN = MissionParams(approach_time=8.0, land_time=20.0, hold_time=2.0)
HOME = np.array([0.1, -0.2, 0.18])
NOWHERE = (math.nan,) * 3


class World:
    """A vehicle that follows the set point with a lag of 0.1 s, and the course, at 50 Hz."""

    def __init__(self, place=HOME, plan=PLAN, started=True, epoch=START):
        self.course = Mission(plan, MissionLimits(), started)
        self.place = np.array(place, float)
        self.velocity = np.zeros(3)
        self.now = epoch
        self.odometry = self.answers = True
        self.follows = True
        self.setpoints = []
        self.modes = []

    def reaction(self, state, x_r=NOWHERE, count=0, age_s=0.0):
        stamp = self.now - round(1e9 * age_s)
        self.course.reaction(state, np.array(x_r, dtype=float), count, stamp, self.now)

    def run(self, seconds, stop=lambda world: False):
        for _ in range(round(seconds * 50)):
            self.now += 20 * MS
            if self.odometry:
                self.course.estimate(self.place.copy(), self.velocity.copy(), self.now)
            if self.answers:
                self.course.reaction_alive(self.now)
            setpoint = dict(self.course.step(self.now)).get("/mission/setpoint")
            if setpoint is not None:
                self.setpoints.append(setpoint)
                if not self.modes or setpoint.phase != self.modes[-1]:
                    self.modes.append(setpoint.phase)
                self.follow(setpoint)
            if stop(self):
                break
        return self

    def follow(self, setpoint):
        before = self.place
        if self.follows and setpoint.phase not in (Phase.IDLE, Phase.LANDED):
            self.place = before + 0.2 * (setpoint.position - before) + 0.016 * setpoint.velocity
        self.place = np.maximum(self.place, [-math.inf, -math.inf, HOME[2]])
        self.velocity = (self.place - before) / 0.02

    def until(self, mode, patience=60.0):
        self.run(patience, lambda world: world.course.mode == mode)
        assert self.course.mode == mode
        return self

    def largest_step(self, since=0):
        places = np.array([s.position for s in self.setpoints[since:]])
        return np.linalg.norm(np.diff(places, axis=0), axis=1).max(initial=0.0)


class Follower:
    """A vehicle that is where the mission's reference is; looked at every `step` seconds."""

    def __init__(self, plan=PLAN, step=1.0 / 30.0):
        self.plan, self.step = plan, step
        self.state = MissionMemory.new()
        begin(self.state, HOME)
        self.position = HOME
        self.n = 0
        self.rows = []

    @property
    def now(self):
        return self.n * self.step

    def run(self, until=700.0, mode=Phase.LANDED):
        """Fly until a time [s], or until a mode."""
        while self.now < until and self.state.mode != mode:
            self.n += 1
            now, yaw = self.now, leg_yaw(self.state.leg, self.now)
            there = np.array(leg_position(self.state.leg, now))
            there[2] = max(there[2], HOME[2])
            velocity = (there - self.position) / self.step
            self.position = there
            advance_mission(self.state, compiled_plan(self.plan), now, there, velocity)
            self.rows.append((now, self.state.mode, there, yaw, self.state.steps))
        return self

    def column(self, i):
        return np.array([row[i] for row in self.rows])
