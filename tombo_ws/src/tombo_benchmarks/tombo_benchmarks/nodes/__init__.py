"""Timing of the nodes in real time."""
