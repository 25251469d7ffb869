"""Real flights of known causes, of which the commands are asked."""
