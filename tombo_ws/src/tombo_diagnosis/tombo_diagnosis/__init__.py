"""Diagnosis: where a simulation is wrong, why, and how much better the extended model predicts.

Offline and without ROS: a `tombo_bag.flight.Flight` is diagnosed, `diagnosis` holds the result.
"""
