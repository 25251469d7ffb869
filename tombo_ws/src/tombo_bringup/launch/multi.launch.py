"""Several vehicles: `ros2 launch tombo_bringup multi.launch.py vehicles:=2 record:=runs/bag`.

As `tombo up --vehicles`: namespaces v1, v2, each vehicle a process, one recording of all.
"""

from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from tombo_bringup.launching import NEW_FOLDER, command

ARGUMENTS = {
    "vehicles": ("2", "how many, each in a namespace: v1, v2"),
    "scenario": ("hover", "what each flies: a name of `tombo list scenarios`, or a YAML file"),
    "seed": ("0", "of the first vehicle's chance; the next one counts on"),
    "record": (NEW_FOLDER, "folder for recording, parameters and logs, new or empty"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the `tombo up` command with its arguments."""
    vehicles, scenario, seed, record = map(LaunchConfiguration, ARGUMENTS)
    return command(
        ["up", scenario, "--vehicles", vehicles, "--seed", seed, "-o", record], ARGUMENTS
    )
