"""Fly a scenario headless: `ros2 launch tombo_bringup fly.launch.py scenario:=hover seed:=3`."""

import time

from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.substitutions import ExecutableInPackage

from launch import LaunchDescription

_FOLDER = time.strftime("runs/launched-%Y%m%d-%H%M%S")


def generate_launch_description() -> LaunchDescription:
    """Return the `tombo fly` command with its arguments."""
    arguments = (
        (
            "scenario",
            "paper_collision",
            "built-in name (`tombo list scenarios`) or path of a YAML file",
        ),
        ("seed", "0", "all randomness of the flight derives from it"),
        ("folder", _FOLDER, "where the files go: a folder, new or empty"),
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in arguments
    ]
    scenario, seed, folder = (LaunchConfiguration(name) for name, _, _ in arguments)
    tombo = ExecutableInPackage(executable="tombo", package="tombo_bringup")
    command = [tombo, "fly", scenario, "--seed", seed, "-o", folder]
    return LaunchDescription([*declared, ExecuteProcess(cmd=command, output="screen")])
