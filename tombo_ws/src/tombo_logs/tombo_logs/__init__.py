"""Measured flights: readers of logs, their checks, and proposals of mapping files.

Offline and without ROS: `flight_log` holds what was measured.
"""
