"""Sweeps: one scenario flown over a design of settings and seeds, into one table."""
