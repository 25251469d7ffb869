"""Flies crazyflow over the same course as this simulator: `python -m tombo_benchmarks.peers`."""
