"""How cost grows, by `python -m tombo_benchmarks.growth`."""
