"""The top of the suite: the lab file, the guided first flight and the `tombo` command."""

PX4_OF_LAB = "lab"
"""Value of `--px4` without a URL: that of the lab file, else PX4 is simulated."""
