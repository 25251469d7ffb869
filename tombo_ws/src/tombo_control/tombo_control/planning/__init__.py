"""The mission's plan: legs, course, phases."""
