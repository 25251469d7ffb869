"""Checks of stamps: units, resets, rates, jitter, gaps."""
