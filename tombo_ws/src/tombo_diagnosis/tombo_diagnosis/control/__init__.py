"""The controller of measured flights: its gains, and how its loops swing."""
