"""Recommends a nodus for a vehicle: candidates, what is known of each, choice, and check."""
