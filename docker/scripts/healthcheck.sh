#!/usr/bin/env bash
# Healthy when every node of $TOMBO_NODES ("estimator controller") runs; without it always.
#
# Looks at processes only: a look into the graph would cost as much as a node does.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

for node in ${TOMBO_NODES:-}; do
  grep -qzsE "(^|/)${node}_node$" /proc/[0-9]*/cmdline || {
    echo "the node $node does not run"
    exit 1
  }
done
