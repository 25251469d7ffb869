"""Estimator, controller and mission: `ros2 launch tombo_bringup control.launch.py`.

The mission waits on the ground for `ros2 service call /mission/takeoff std_srvs/srv/Trigger`.
"""

from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from tombo_bringup.launching import description, suite_node

ARGUMENTS = {"auto_start": ("false", "true: take off without a command")}


def generate_launch_description() -> LaunchDescription:
    """Return what flies the vehicle."""
    starts = ParameterValue(LaunchConfiguration("auto_start"), value_type=bool)
    nodes = [suite_node("tombo_control", name) for name in ("estimator", "controller")]
    mission = suite_node("tombo_control", "mission", auto_start=starts)
    return description([*nodes, mission], ARGUMENTS)
