"""Several vehicles: `ros2 launch tombo_bringup multi.launch.py vehicles:=2 record:=runs/bag`.

As `tombo up --vehicles`: namespaces v1, v2, each vehicle a process, one recording of all.
"""

import time

from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.substitutions import ExecutableInPackage

from launch import LaunchDescription

_FOLDER = time.strftime("runs/launched-%Y%m%d-%H%M%S")


def generate_launch_description() -> LaunchDescription:
    """Return the `tombo up` command with its arguments."""
    arguments = (
        ("vehicles", "2", "how many, each in a namespace: v1, v2"),
        ("scenario", "hover", "what each flies: built-in name or path of a YAML file"),
        ("seed", "0", "of the first vehicle's chance; the next one counts on"),
        ("record", _FOLDER, "folder for recording, parameters and logs, new or empty"),
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in arguments
    ]
    vehicles, scenario, seed, record = (LaunchConfiguration(name) for name, _, _ in arguments)
    tombo = ExecutableInPackage(executable="tombo", package="tombo_bringup")
    command = [tombo, "up", scenario, "--vehicles", vehicles, "--seed", seed, "-o", record]
    return LaunchDescription([*declared, ExecuteProcess(cmd=command, output="screen")])
