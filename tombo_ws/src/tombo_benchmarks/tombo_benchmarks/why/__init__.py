"""Simulated crashes of known causes, of which `tombo why` is asked."""
