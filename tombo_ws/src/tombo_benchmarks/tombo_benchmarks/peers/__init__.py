"""Flies other simulators on the same course as this one: `python -m tombo_benchmarks.peers`."""
