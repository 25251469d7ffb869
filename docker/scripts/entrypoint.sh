#!/usr/bin/env bash
# Becomes the given command, with ROS, the workspace and the tombo command at hand.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

ros_setup
source_setup "$TOMBO_PREFIX/setup.bash"
export PATH="$PATH:$TOMBO_PREFIX/lib/tombo_bringup"
exec "$@"
