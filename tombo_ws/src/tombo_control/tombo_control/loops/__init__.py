"""The control loops, from position to rotors."""
