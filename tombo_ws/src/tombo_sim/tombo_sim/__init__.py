"""The simulator: one compiled loop of physics, sensors, estimator and cascade at 1 kHz."""
