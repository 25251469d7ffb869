"""Proposes a mapping for a log that nobody has described yet."""
