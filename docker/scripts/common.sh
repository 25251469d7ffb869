# shellcheck shell=bash
# Sourced by the other scripts.

set -euo pipefail

source_setup() { # a setup file of ROS or colcon: these use variables that are not set
  set +u
  # shellcheck source=/dev/null
  . "$1"
  set -u
}

ros_setup() { source_setup "${ROS_SETUP:-/opt/ros/${ROS_DISTRO:-jazzy}/setup.bash}"; }
