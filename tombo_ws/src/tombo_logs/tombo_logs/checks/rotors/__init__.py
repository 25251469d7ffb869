"""Checks of rotor speeds and commands."""
