#!/usr/bin/env bash
# Installs what the packages need from Debian packages: 10_system.sh FOLDER_OF_MANIFESTS
#
# Python libraries come with 20_python.sh, so rosdep leaves their keys out: Ubuntu 24.04 has no
# python3-numba, and pip as rosdep calls it would replace packages of the system.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

readonly manifests="$1"

mapfile -t python_keys < <(
  grep -ohE 'depend>(python3-[a-z0-9-]+|mcap-ros2-support)<' "$manifests"/*/package.xml |
    sed 's/depend>//; s/<//' | sort -u
)
[ ${#python_keys[@]} -gt 0 ] || { echo "no manifests under $manifests" >&2; exit 1; }
apt-get update
DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends python3-venv
DEBIAN_FRONTEND=noninteractive rosdep install --rosdistro "${ROS_DISTRO:-jazzy}" \
  --from-paths "$manifests" --ignore-src --default-yes --skip-keys "${python_keys[*]}"
