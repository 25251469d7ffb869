"""Scenarios and their flights: headless, with nodes, replayed; metrics, reports, sweeps."""
