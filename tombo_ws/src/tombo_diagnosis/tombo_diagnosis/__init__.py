"""Diagnosis: where a simulation is wrong, why, and how much better the extended model predicts.

Offline and without ROS: `flight_log` holds what was measured, `diagnosis` what was found.
"""
