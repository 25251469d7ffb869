"""From measured tables to operating points."""
