"""Measured flights: readers of logs, their checks, and proposals of mapping files.

Offline and without ROS. Readers give a `tombo_bag.flight.Flight`.
"""
