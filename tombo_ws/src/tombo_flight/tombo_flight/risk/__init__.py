"""Risk: how probable a crash is when inputs are uncertain, and what decides it."""
