"""The suite in a browser: a flight while it happens or is played back, and the propeller."""
