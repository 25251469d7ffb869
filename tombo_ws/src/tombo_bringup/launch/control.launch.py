"""Estimator, controller and mission: `ros2 launch tombo_bringup control.launch.py`."""

from launch import LaunchDescription
from tombo_bringup.launching import description, suite_node


def generate_launch_description() -> LaunchDescription:
    """Return what flies the vehicle."""
    nodes = ("estimator", "controller", "mission")
    return description([suite_node("tombo_control", name) for name in nodes])
