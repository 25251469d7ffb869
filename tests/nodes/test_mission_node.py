"""The mission over DDS, stepped by /clock: courses, goals, and an operator's commands."""

import itertools
import time

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from parameter_calls import call_trigger
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from reports import finding, heard

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
from tombo_msgs.action import FlyCourse
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


class Course:
    """The action `fly_course` as a client sees it, while a flight goes on."""

    def __init__(self, flight, *goals, speed=1.0):
        self.flight, self.told = flight, []
        world = flight.world
        self.executor = SingleThreadedExecutor(context=world.node.context)
        self.executor.add_node(world.node)
        self.client = ActionClient(world.node, FlyCourse, "fly_course")
        goal = FlyCourse.Goal(waypoints=[_goal(*at) for at in goals], speed=speed)
        self.until(self.client.server_is_ready)
        sent = self.client.send_goal_async(goal, lambda said: self.told.append(said.feedback))
        self.until(sent.done)
        self.handle = sent.result()
        assert self.handle.accepted
        self.result = self.handle.get_result_async()

    def until(self, done, patience_s=30.0):
        end = time.monotonic() + patience_s
        while not done():
            assert time.monotonic() < end
            self.flight.step()
            time.sleep(0.01)  # feedback comes by the wall's clock
            self.executor.spin_once(timeout_sec=0.0)

    def end(self):
        self.until(self.result.done)
        self.executor.remove_node(self.flight.world.node)
        self.client.destroy()
        return self.result.result()


def test_flies_courses_and_goals_that_are_commanded(world, start):
    more = ["mission.approach_time:=500.0", "mission.land_time:=600.0"]
    flight = Flight(world, start, more=more)
    ground = Course(flight, (0.5, 0.0))
    refused = ground.end()
    assert refused.status == GoalStatus.STATUS_ABORTED
    assert "accepted: hover, approach, hold" in refused.result.message
    flight.until(MissionStatus.HOVER)

    course = Course(flight, (0.5, 0.0), (0.5, 0.6, 1.1))
    flown = course.end()
    assert flown.status == GoalStatus.STATUS_SUCCEEDED
    assert flown.result.completed
    assert flight.place == pytest.approx([0.5, 0.6, 1.1], abs=0.01)
    assert {said.leg for said in course.told} <= {1, 2}
    assert course.told[0].legs == 2
    assert course.told[0].distance > course.told[-1].distance
    assert course.told[0].time_left > course.told[-1].time_left

    course = Course(flight, (5.0, 0.6))
    course.until(lambda: flight.place[0] > 1.0)
    cancelled = course.handle.cancel_goal_async()
    course.until(cancelled.done)
    assert course.end().status == GoalStatus.STATUS_CANCELED
    there = flight.place.copy()
    for _ in range(20):
        flight.step()
    assert flight.place == pytest.approx(there, abs=0.05)

    course = Course(flight, (-5.0, 0.6))
    world.meet(GOAL_POSE)
    looks = itertools.count()

    def aborted():
        if next(looks) % 25 == 0:  # one may be lost until the node has found this publisher, too
            world.publish(GOAL_POSE, _goal(0.0, 0.0))  # as RViz says it: without a height
        return course.result.done()

    course.until(aborted)
    assert course.end().status == GoalStatus.STATUS_ABORTED
    for _ in range(200):
        flight.step()
    assert flight.place == pytest.approx([0.0, 0.0, 1.1], abs=0.01)
    nowhere = _goal(0.0, 0.0)
    nowhere.header.frame_id = "odom"
    begun = len(world.heard[DIAGNOSTICS.name])
    world.publish(GOAL_POSE, nowhere)
    flight.step()
    text = finding(world, "mission", "goal_refused", begun, meanwhile=flight.step)
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
