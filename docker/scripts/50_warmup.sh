#!/usr/bin/env bash
# Compiles the numerical kernels into $TOMBO_CACHE_DIR, so that the first flight starts at once.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

ros_setup
source_setup "$TOMBO_PREFIX/setup.bash"
"$TOMBO_PYTHON" -m tombo_bringup.warmup
