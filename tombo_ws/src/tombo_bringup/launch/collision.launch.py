"""Detector and reaction: `ros2 launch tombo_bringup collision.launch.py`.

The reaction hands the mission's setpoint on to the controller: without it nothing flies.
"""

from launch import LaunchDescription
from tombo_bringup.launching import description, suite_node


def generate_launch_description() -> LaunchDescription:
    """Return what notices a collision and answers it."""
    nodes = ("detector", "reaction")
    return description([suite_node("tombo_collision", name) for name in nodes])
