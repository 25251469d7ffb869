"""Rigs: benchmarks, fault checks, flights with a real PX4, and the makers of the documentation."""
