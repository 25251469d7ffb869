"""The wiring of a flight, as data: which cores there are and what each gets.

Publishers and subscribers of a topic follow from the cores' `inputs` and `outputs`. The nodes,
the replay, the Python reference and the documentation read this; `flight_loop` has their tick.
"""

from __future__ import annotations

from tombo_collision.detector_core import DetectorCore
from tombo_collision.reaction_core import ReactionCore
from tombo_control.controller_core import ControllerCore
from tombo_control.estimator_core import EstimatorCore
from tombo_control.mission_core import MissionCore
from tombo_dynamics.core import Core, Output
from tombo_dynamics.messages import Imu, Pose

CORES: tuple[type[Core], ...] = (
    EstimatorCore,
    DetectorCore,
    ReactionCore,
    MissionCore,
    ControllerCore,
)
"""The cores of a flight, in the order in which they are listed everywhere."""
PX4_REPLACES = (EstimatorCore, ControllerCore)
"""Cores whose place PX4 and the bridge to it take."""
POSE, IMU = "/mocap/pose", "/imu/data_raw"
SENSORS = {POSE: Output(Pose), IMU: Output(Imu)}
"""Topics that the simulator publishes and cores take."""
OPERATOR = ("/goal_pose",)
"""Topics that people and other programs publish."""
COMMAND, PHASE = "/rotor_command", "/mission/status"
"""Topics that the simulator takes."""
