"""Logs of PX4, and its frames: NED and FRD are nowhere else in this package."""
