"""Detector and reaction: `ros2 launch tombo_bringup collision.launch.py`.

The reaction hands the mission's setpoint on to the controller: without it nothing flies.
"""

from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from tombo_bringup.launching import description, suite_node

ARGUMENTS = {"reaction": ("", "a name of `tombo list reactions`; empty: that of params_file")}


def generate_launch_description() -> LaunchDescription:
    """Return what notices a collision and answers it."""
    name = LaunchConfiguration("reaction")
    named = NotEqualsSubstitution(name, "")
    as_in_file = {"condition": UnlessCondition(named)}
    by_name = {"condition": IfCondition(named), "reaction": ParameterValue(name, value_type=str)}
    reactions = [suite_node("tombo_collision", "reaction", **it) for it in (as_in_file, by_name)]
    return description([suite_node("tombo_collision", "detector"), *reactions], ARGUMENTS)
