"""The one place where the pure packages meet ROS 2: loop, topics, parameters, health, clock."""
