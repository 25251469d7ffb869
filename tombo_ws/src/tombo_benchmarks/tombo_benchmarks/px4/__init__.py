"""Flights with a real PX4 SITL, in one process and in lockstep with it."""
