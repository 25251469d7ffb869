"""The suite in a browser: a flight while it happens, or one that is played back."""
