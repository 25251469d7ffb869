"""The collision detector on the motion-capture pose, and the reaction to a collision."""
