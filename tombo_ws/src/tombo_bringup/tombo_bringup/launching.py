"""Shared by the launch files: their arguments, and the action that starts a node.

Only launch files import this: `launch` and `launch_ros` come with a standard ROS 2 install.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

from launch import LaunchDescription

PACKAGE = "tombo_bringup"

COMMON: dict[str, tuple[Any, str]] = {
    "params_file": (
        [FindPackageShare(PACKAGE), "/config/suite.yaml"],
        "YAML file with the ROS parameters of the nodes",
    ),
    "namespace": ("", "put before all names, for more than one vehicle"),
    "use_sim_time": ("false", "true: follow /clock, which the simulator publishes"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
}
"""Arguments of every launch file that starts nodes: name -> default, meaning."""
NEW_FOLDER = time.strftime("runs/launched-%Y%m%d-%H%M%S")


def description(actions: Sequence[Any], more: Mapping[str, tuple[Any, str]] | None = None) -> Any:
    """Return a launch description: the common arguments, some more, and the actions."""
    return LaunchDescription([*_declared({**COMMON, **(more or {})}), *actions])


def command(words: Sequence[Any], arguments: Mapping[str, tuple[Any, str]]) -> Any:
    """Return a launch description that runs `tombo` with words, some of them arguments."""
    tombo = ExecutableInPackage(executable="tombo", package=PACKAGE)
    run = ExecuteProcess(cmd=[tombo, *words], output="screen")
    return LaunchDescription([*_declared(arguments), run])


def _declared(arguments: Mapping[str, tuple[Any, str]]) -> list[Any]:
    return [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in arguments.items()
    ]


def suite_node(package: str, name: str, **more: Any) -> Any:
    """Return the action that starts a node of the suite.

    Args:
        package: which has the executable `<name>_node`.
        name: of the node.
        more: further parameters by name, over those of `params_file`; `condition`: of the action;
            `executable`: one of another name.
    """
    condition = more.pop("condition", None)
    executable = more.pop("executable", f"{name}_node")
    simulated = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    return Node(
        package=package,
        executable=executable,
        # With the full name given, launch writes the parameters below for this node alone, and
        # they win over every wildcard in the file.
        name=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("params_file"), {"use_sim_time": simulated, **more}],
        ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        output="screen",
        condition=condition,
    )


def part(file: str, *more: str, condition: Any = None) -> Any:
    """Return the inclusion of another launch file, with the common arguments and some more."""
    return IncludeLaunchDescription(
        PythonLaunchDescriptionSource([FindPackageShare(PACKAGE), f"/launch/{file}"]),
        launch_arguments=[(name, LaunchConfiguration(name)) for name in (*COMMON, *more)],
        condition=condition,
    )
