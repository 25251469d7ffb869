"""The simulator: physics at 1 kHz, contact with an obstacle, motion capture and inertial sensors."""
