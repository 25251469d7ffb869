"""Physics for a real PX4 SITL, in lockstep."""
