"""Sweeps: scenarios flown over a design of settings and seeds, into one table and one page."""
