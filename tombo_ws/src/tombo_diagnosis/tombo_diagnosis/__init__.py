"""What a simulation gets wrong, why, and how much better it is once it has been extended.

Offline and without ROS: `flight_log` holds what was measured, `diagnosis` what was found.
"""
