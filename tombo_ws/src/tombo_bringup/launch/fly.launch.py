"""Fly a scenario headless: `ros2 launch tombo_bringup fly.launch.py scenario:=hover seed:=3`."""

from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from tombo_bringup.launching import NEW_FOLDER, command

ARGUMENTS = {
    "scenario": ("paper_collision", "a name of `tombo list scenarios`, or a YAML file"),
    "seed": ("0", "all randomness of the flight derives from it"),
    "folder": (NEW_FOLDER, "where the files go: a folder, new or empty"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the `tombo fly` command with its arguments."""
    scenario, seed, folder = map(LaunchConfiguration, ARGUMENTS)
    return command(["fly", scenario, "--seed", seed, "-o", folder], ARGUMENTS)
