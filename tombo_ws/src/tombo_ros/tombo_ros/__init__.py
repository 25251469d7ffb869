"""The interface to ROS 2 of all nodes: loop, topics, parameters, health, clock."""
