"""Recommends a nodus for a vehicle: candidates, their known figures, choice, and check."""
