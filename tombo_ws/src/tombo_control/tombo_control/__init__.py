"""The cascade: estimator, position, attitude and rate control, allocation and mission."""
