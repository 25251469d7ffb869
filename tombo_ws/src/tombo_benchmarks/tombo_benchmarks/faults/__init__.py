"""A model of the suite for its faults, and nodes that are killed in flight."""
