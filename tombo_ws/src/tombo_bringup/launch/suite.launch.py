"""The whole suite as nodes: `ros2 launch tombo_bringup suite.launch.py rviz:=true`.

With a real vehicle in place of the simulator: `sim:=false`; it waits for `/mission/takeoff`.
"""

from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from tombo_bringup.launching import PACKAGE, description, part

ARGUMENTS = {
    "sim": ("true", "start the simulated vehicle; false: something else speaks its topics"),
    "auto_start": (
        LaunchConfiguration("sim"),
        "true: take off without a command; default: only a simulated vehicle",
    ),
    "reaction": ("", "a name of `tombo list reactions`; empty: that of params_file"),
    "speed": ("1.0", "of the simulation, times real time; not 1 only with use_sim_time:=true"),
    "record": ("", "folder for the bag; empty: nothing is recorded"),
    "rviz": ("false", "true: start RViz (rviz2)"),
    "foxglove": ("false", "true: start the bridge for Foxglove, port 8765 (foxglove_bridge)"),
}


def generate_launch_description() -> LaunchDescription:
    """Return all nodes, and the tools that were asked for."""
    clock = {"use_sim_time": LaunchConfiguration("use_sim_time")}
    return description(
        [
            part("sim.launch.py", "speed", condition=IfCondition(LaunchConfiguration("sim"))),
            part("control.launch.py", "auto_start"),
            part("collision.launch.py", "reaction"),
            part(
                "recorder.launch.py",
                "record",
                condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration("record"), "")),
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", [FindPackageShare(PACKAGE), "/rviz/tombo.rviz"]],
                parameters=[clock],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
            Node(
                package="foxglove_bridge",
                executable="foxglove_bridge",
                parameters=[clock],
                condition=IfCondition(LaunchConfiguration("foxglove")),
            ),
        ],
        ARGUMENTS,
    )
