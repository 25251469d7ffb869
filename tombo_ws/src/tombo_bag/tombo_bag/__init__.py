"""Flights as MCAP files: written and read without ROS, readable by every ROS 2 tool."""
