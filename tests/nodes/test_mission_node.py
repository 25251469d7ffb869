"""The mission over DDS, stepped by /clock: courses, goals, and an operator's commands."""

import itertools
import time

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from parameter_calls import call_trigger
from reports import heard, told

from ros_bench import point, vector
from tombo_bag.topics import (
    CLOCK,
    DIAGNOSTICS,
    GOAL_POSE,
    MISSION_SETPOINT,
    MISSION_STATUS,
    ODOMETRY,
    REACTION_STATUS,
    SETPOINT,
)
from tombo_msgs.msg import MissionStatus
from tombo_ros.conversion import array, to_ns, to_time

MS = 1_000_000
PLAN = {
    "takeoff_time": 0.2,
    "height": 0.8,
    "climb_speed": 2.0,
    "approach_time": 2.0,
    "hold_time": 0.2,
    "land_speed": 2.0,
}


class Flight:
    """A vehicle that is where the mission wants it, and a reaction that agrees."""

    def __init__(self, world, start, more=()):
        self.world = world
        self.place, self.velocity = np.array([0.0, 0.0, 0.18]), np.zeros(3)
        world.now_ns = 1_763_700_000_123_456_789
        world.subscribe(MISSION_SETPOINT, MISSION_STATUS, DIAGNOSTICS)
        arguments = [f"mission.{name}:={value}" for name, value in PLAN.items()]
        arguments += ["use_sim_time:=true", *more]
        self.node = start("tombo_control.mission_node", *(a for p in arguments for a in ("-p", p)))
        world.meet(CLOCK, ODOMETRY, SETPOINT, REACTION_STATUS)
        world.meet(MISSION_SETPOINT, MISSION_STATUS, DIAGNOSTICS)
        heard(world, MISSION_SETPOINT, meanwhile=lambda: self._publish(MS))  # nothing gets old

    def _publish(self, by_ns=20 * MS):
        world = self.world
        message = Odometry(child_frame_id="base_link")
        message.header.stamp, message.header.frame_id = to_time(world.now_ns), "map"
        message.pose.pose.position = point(self.place)
        message.twist.twist.linear = vector(self.velocity)
        world.publish(ODOMETRY, message)
        world.tick(by_ns)

    def step(self):
        """20 ms: publish the estimate, wait for the set point, be there."""
        world = self.world
        self._publish()
        said = world.heard[MISSION_SETPOINT.name]
        begun = again = time.monotonic()
        while not said or to_ns(said[-1].header.stamp) < world.now_ns:
            now = time.monotonic()
            assert now < begun + 30.0, "no set point"
            if now > again + 1.0:  # a message of the clock may be lost
                self._publish(0)
                again = now
            time.sleep(0.0005)
            world.hear()
        world.publish(SETPOINT, said[-1])
        before = self.place
        if said[-1].phase not in (MissionStatus.IDLE, MissionStatus.LANDED):
            self.place = np.maximum(array(said[-1].position), [-9.0, -9.0, 0.18])
        self.velocity = (self.place - before) / 0.02
        return said[-1]

    def until(self, phase, patience_s=6.0):
        for _ in range(round(patience_s * 50)):
            said = self.step()
            if said.phase == phase:
                return said
        raise AssertionError(f"never in phase {phase}")


def _goal(x, y, z=0.0):
    goal = PoseStamped()
    goal.header.frame_id = "map"
    goal.pose.position = point((x, y, z))
    return goal


def test_flies_to_goals_that_are_commanded(world, start):
    more = [
        "mission.approach_time:=500.0",
        "mission.land_time:=600.0",
        "mission.approach_speed:=1.0",
    ]
    flight = Flight(world, start, more=more)
    flight.until(MissionStatus.HOVER)
    world.meet(GOAL_POSE)
    for looks in itertools.count():
        if looks % 25 == 0:  # one may be lost until the node has found this publisher, too
            world.publish(GOAL_POSE, _goal(0.5, 0.6))  # as RViz says it: without a height
        if flight.step().phase == MissionStatus.APPROACH:
            break
        assert looks < 500, "the goal is not flown to"
    for _ in range(200):
        flight.step()
    assert flight.place == pytest.approx([0.5, 0.6, PLAN["height"]], abs=0.01)
    nowhere = _goal(0.0, 0.0)
    nowhere.header.frame_id = "odom"
    begun = len(world.heard[DIAGNOSTICS.name])
    world.publish(GOAL_POSE, nowhere)
    flight.step()
    text = told(world, "mission", "goal_refused", begun, meanwhile=flight.step)
    assert "frame 'odom'; accepted: map" in text
    assert flight.node.end() == 0


def test_an_operator_takes_off_and_lands_by_services(world, start):
    flight = Flight(world, start, more=["auto_start:=false"])
    assert flight.step().phase == MissionStatus.IDLE
    assert call_trigger(world, "mission", "hold") == (False, "nothing to hold: phase idle")
    assert call_trigger(world, "mission", "takeoff") == (True, "")
    flight.until(MissionStatus.HOVER)
    assert call_trigger(world, "mission", "takeoff")[0] is False, "it flies"
    assert call_trigger(world, "mission", "land") == (True, "")
    flight.until(MissionStatus.LANDED)
