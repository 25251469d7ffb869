"""The simulated vehicle with its sensors: `ros2 launch tombo_bringup sim.launch.py`."""

from launch.substitutions import LaunchConfiguration
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from tombo_bringup.launching import description, suite_node

ARGUMENTS = {"speed": ("1.0", "times real time; other than 1 only with use_sim_time:=true")}


def generate_launch_description() -> LaunchDescription:
    """Return the simulator."""
    speed = ParameterValue(LaunchConfiguration("speed"), value_type=float)
    return description([suite_node("tombo_sim", "sim", speed=speed)], ARGUMENTS)
