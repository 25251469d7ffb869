"""Regenerates what the documentation takes from the code: pictures, tables, figures."""
