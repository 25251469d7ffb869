#!/usr/bin/env bash
# Installs the bridge that Foxglove connects to.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

apt-get update
DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends \
  "ros-${ROS_DISTRO:-jazzy}-foxglove-bridge"
