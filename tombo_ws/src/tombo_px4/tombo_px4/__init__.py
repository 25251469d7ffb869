"""PX4: the MAVLink link and bridge to it, a simulated one, and physics for a real one."""
