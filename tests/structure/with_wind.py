"""Runs a module with the core `Wind...` of wind_core.py in the wiring.

    python -m with_wind MODULE ...

A line in `CORES` does the same for good.
"""

from __future__ import annotations

import os
import runpy
import sys

import wind_core

from tombo_sim import wiring

KIND = "TOMBO_TEST_CORE"
"""Environment: the class."""

if __name__ == "__main__":
    wiring.CORES = (*wiring.CORES, getattr(wind_core, os.environ[KIND]))
    sys.argv = sys.argv[1:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
