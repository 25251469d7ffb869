"""The suite over MAVLink: `ros2 launch tombo_bringup px4.launch.py record:=runs/bag`.

A simulated PX4 by default. With `sim:=false` it flies the PX4 at `url`, as soon as that is there:
with a motion capture on mocap/pose, or with `hil:=true` one that connects to our simulator link.
"""

from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from tombo_bringup.launching import description, part, suite_node

ARGUMENTS = {
    "sim": ("true", "simulate PX4, vehicle and motion capture; false: there are such already"),
    "hil": ("false", "true, with sim:=false: vehicle and motion capture for a real PX4 SITL"),
    "url": ("udpin://127.0.0.1:14540", "of the bridge's link to PX4; arms what is there"),
    "auto_start": (
        LaunchConfiguration("sim"),
        "true: take off without a command; default: only a simulated vehicle",
    ),
    "simulated": (
        LaunchConfiguration("sim"),
        "true: the poses are of a model, their axes need no proof; with hil:=true, set it",
    ),
    "reaction": ("", "a name of `tombo list reactions`; empty: that of params_file"),
    "record": ("", "folder for the bag; empty: nothing is recorded"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the bridge and the nodes around it; PX4 has estimator and controller."""
    starts = ParameterValue(LaunchConfiguration("auto_start"), value_type=bool)
    url = {"link.url": LaunchConfiguration("url")}
    simulated = LaunchConfiguration("simulated")
    recording = NotEqualsSubstitution(LaunchConfiguration("record"), "")
    return description(
        [
            suite_node(
                "tombo_px4",
                "sim",
                executable="px4_sim_node",
                condition=IfCondition(LaunchConfiguration("sim")),
            ),
            suite_node(
                "tombo_px4",
                "sim",
                executable="hil_sim_node",
                condition=IfCondition(LaunchConfiguration("hil")),
            ),
            suite_node("tombo_px4", "px4_bridge", condition=UnlessCondition(simulated), **url),
            suite_node(
                "tombo_px4",
                "px4_bridge",
                condition=IfCondition(simulated),
                **url,
                **{"px4.axes_evidence": "simulated"},
            ),
            suite_node("tombo_control", "mission", auto_start=starts),
            part("collision.launch.py", "reaction"),
            part("recorder.launch.py", "record", condition=IfCondition(recording)),
        ],
        ARGUMENTS,
    )
