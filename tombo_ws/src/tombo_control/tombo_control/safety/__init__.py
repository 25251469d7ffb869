"""What ends a flight that has lost something: states, touchdown, limits of the flight."""
