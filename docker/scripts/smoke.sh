#!/usr/bin/env bash
# Starts each node for a moment, stops it as Ctrl-C would, and wants it to end well: smoke.sh [NODE ...]
#
# A node counts as started when it has said that it runs.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

readonly patience="${TOMBO_PATIENCE:-30}" # s, for a start on a busy machine
set -m                                   # else a job of the shell ignores SIGINT

ros_setup
source_setup "$TOMBO_PREFIX/setup.bash"
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID="${ROS_DOMAIN_ID:-97}"
log="$(mktemp -d)"
trap 'rm -rf "$log"' EXIT
export ROS_LOG_DIR="$log"
cd "$log"

try() { # try EXECUTABLE
  local name code=0 waited=0
  name="$(basename "$1")"
  : >"$log/out" # it is looked into before a busy machine has begun the job
  "$1" >>"$log/out" 2>&1 &
  local pid=$!
  until grep -q running "$log/out" || [ $waited -ge $((10 * patience)) ] || ! kill -0 $pid 2>/dev/null; do
    sleep 0.1
    waited=$((waited + 1))
  done
  kill -INT $pid 2>/dev/null || true
  wait $pid || code=$?
  if [ $code -ne 0 ] || ! grep -q running "$log/out"; then
    cat "$log/out" >&2
    echo "smoke: $name ended with code $code" >&2
    exit 1
  fi
  echo "smoke: $name starts and stops"
}

shopt -s nullglob
found=("$TOMBO_PREFIX"/lib/tombo_*/*_node)
[ ${#found[@]} -gt 0 ] || { echo "smoke: no node under $TOMBO_PREFIX/lib" >&2; exit 1; }
for executable in "${found[@]}"; do
  node="$(basename "$executable" _node)"
  [ $# -eq 0 ] || [[ " $* " == *" $node "* ]] || continue
  try "$executable"
done
