#!/usr/bin/env bash
# Installs the Python libraries, pinned: 20_python.sh REQUIREMENTS FOLDER
#
# Into a virtual environment that sees the system's packages, because
# - Ubuntu's own Python refuses pip (PEP 668), and it is right: rclpy and the tools of ROS belong
#   to the packages of apt, and pip must not replace what they use;
# - Ubuntu 24.04 has no numba, filterpy, rosbags or mcap, and older numpy and scipy than those the
#   tests ran with. With the same pins a flight in the container is the flight of `make fly`.
# Left out are the ROS wheels and what only these need: here ROS is from apt. Its messages are
# compiled for numpy 1 and work with numpy 2: they use what both share.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

readonly requirements="$1" venv="$2"

python3 -m venv --system-site-packages "$venv"
grep -vE '^(ros-|setuptools=|empy=|lark-parser=)' "$requirements" >"$venv/requirements.txt"
"$venv/bin/python" -m pip install --no-input --disable-pip-version-check \
  --requirement "$venv/requirements.txt"
