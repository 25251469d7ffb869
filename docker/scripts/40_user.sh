#!/usr/bin/env bash
# Makes the user who runs the nodes, with folders of its own: 40_user.sh NAME UID FOLDER ...
#
# The user id should be yours: containers and host then read each other's shared memory and files.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

readonly name="$1" uid="$2"
shift 2

taken="$(getent passwd "$uid" | cut -d: -f1)" || true # Ubuntu's image has a user 1000, ubuntu
[ -z "$taken" ] || userdel --remove "$taken"
useradd --uid "$uid" --create-home --shell /bin/bash "$name"
install --directory --owner "$name" "$@"
