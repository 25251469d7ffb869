"""The recorder: `ros2 launch tombo_bringup recorder.launch.py record:=runs/bag`."""

from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from tombo_bringup.launching import description, suite_node

ARGUMENTS = {"record": ("runs/bag", "folder for the bag")}


def generate_launch_description() -> LaunchDescription:
    """Return the recorder."""
    return description(
        [suite_node("tombo_ros", "recorder", output=LaunchConfiguration("record"))], ARGUMENTS
    )
