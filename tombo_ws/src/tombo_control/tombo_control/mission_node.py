"""The mission as a node: flies its plan on the estimate, and follows the reaction's decisions.

Beside the topics it takes the action `fly_course`. Goals come in the services' thread, the core is
touched by the loop only: requests wait for it in a queue, and it returns the answers.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionServer, CancelResponse
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

from tombo_bag.topics import PX4_STATUS
from tombo_control.mission_core import MissionCore
from tombo_control.planning.commanded_course import CourseProgress
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import PHASE_NAMES, Pose
from tombo_msgs.action import FlyCourse
from tombo_ros.conversion import array, to_ns
from tombo_ros.core_node import CoreNode, main_of
from tombo_ros.pacing import MISSION

_FEEDBACK_S = 0.2


@dataclass
class _Course:
    """A goal of the action, between the two threads."""

    handle: Any
    outcome: Any
    """Future of (status, text)."""
    number: int = 0
    """Which of the core's courses it is."""
    progress: CourseProgress | None = None
    """The newest; the feedback has it."""


class MissionNode(CoreNode):
    """Hosts `MissionCore` and the action `fly_course`."""

    core: MissionCore

    def __init__(self) -> None:
        """Offer the action."""
        super().__init__(MissionCore, priority=MISSION)
        self._requests: deque[_Course] = deque()  # filled by the services' thread
        self._flown: _Course | None = None
        self._server = ActionServer(
            self.ros,
            FlyCourse,
            "fly_course",
            execute_callback=self._execute,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )
        self._px4_status = self.subscribe(PX4_STATUS)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.ros.create_timer(_FEEDBACK_S, self._send_feedback, clock=steady)
        self._timer.cancel()

    # --- In the services' thread ---------------------------------------------------------------

    async def _execute(self, handle: Any) -> Any:
        """Hand a goal to the loop, and say what became of it."""
        course = _Course(handle, Future())
        self._requests.append(course)
        self._timer.reset()
        status, text = await course.outcome
        if self._flown is None:
            self._timer.cancel()
        ends = {
            GoalStatus.STATUS_SUCCEEDED: handle.succeed,
            GoalStatus.STATUS_CANCELED: handle.canceled,
        }
        ends.get(status, handle.abort)()
        return FlyCourse.Result(completed=status == GoalStatus.STATUS_SUCCEEDED, message=text)

    def _send_feedback(self) -> None:
        course = self._flown
        progress = None if course is None else course.progress
        if course is not None and progress is not None:
            course.handle.publish_feedback(
                FlyCourse.Feedback(
                    leg=progress.leg,
                    legs=progress.legs,
                    distance=progress.distance,
                    time_left=progress.time_left,
                )
            )

    # --- In the loop ---------------------------------------------------------------------------

    def step_core(self, now_ns: int) -> None:
        """Take PX4's status, begin what was asked for, step, and watch the course."""
        for arrival in self._px4_status.take():
            self.core.vehicle_status = arrival.message
        while self._requests:
            self._begin(self._requests.popleft())
        super().step_core(now_ns)
        if self._flown is not None:
            self._watch(self._flown)

    def _begin(self, course: _Course) -> None:
        goal = course.handle.request
        poses = [
            Pose(
                to_ns(stamped.header.stamp),
                stamped.header.frame_id,
                array(stamped.pose.position),
                array(stamped.pose.orientation),
            )
            for stamped in goal.waypoints
        ]
        try:
            self.core.fly_course("waypoints", poses, goal.speed, goal.hold)
        except InputError as error:
            self._end(course, GoalStatus.STATUS_ABORTED, str(error))
            return
        if self._flown is not None:
            self._end(self._flown, GoalStatus.STATUS_ABORTED, "another course was commanded")
        course.number = self.core.courses
        self._flown = course

    def _watch(self, course: _Course) -> None:
        core = self.core
        course.progress = progress = core.course_progress
        if core.courses != course.number:
            self._finish(course, GoalStatus.STATUS_ABORTED, "another course was commanded")
        elif progress is None:
            text = f"the vehicle flies no course any more: {PHASE_NAMES[core.mode]}"
            self._finish(course, GoalStatus.STATUS_ABORTED, text)
        elif course.handle.is_cancel_requested:
            core.hold_course()
            self._finish(course, GoalStatus.STATUS_CANCELED, "the vehicle holds where it was")
        elif progress.arrived:
            self._finish(
                course, GoalStatus.STATUS_SUCCEEDED, "the vehicle holds at the last place"
            )

    def _finish(self, course: _Course, status: int, text: str) -> None:
        self._flown = None
        self._end(course, status, text)

    def _end(self, course: _Course, status: int, text: str) -> None:
        course.outcome.set_result((status, text))
        self._executor.wake()


main = main_of(MissionNode)

if __name__ == "__main__":
    main()
