#!/usr/bin/env bash
# Builds the workspace: 30_build.sh SOURCES PREFIX [ARGUMENT_OF_CMAKE ...]
#
# colcon runs in the virtual environment's Python, so that the nodes' first lines name it. CMake
# finds the system's, which has the generators of ROS.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

sources="$(realpath "$1")" prefix="$(realpath -m "$2")"
readonly sources prefix
shift 2

ros_setup
build="$(mktemp -d)"
trap 'rm -rf "$build"' EXIT
COLCON_HOME="$build" COLCON_LOG_PATH="$build/log" \
  "${TOMBO_PYTHON:-python3}" "$(command -v colcon)" build \
  --base-paths "$sources" --build-base "$build" --merge-install --install-base "$prefix" \
  --event-handlers status- desktop_notification- console_cohesion+ \
  --cmake-args -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF "$@"
