"""How fast the simulation is on this machine: `make bench`, `python -m tombo_benchmarks.speed`."""
