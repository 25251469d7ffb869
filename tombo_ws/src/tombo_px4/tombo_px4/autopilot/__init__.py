"""The simulated PX4: autopilot, estimator model and vehicle."""
