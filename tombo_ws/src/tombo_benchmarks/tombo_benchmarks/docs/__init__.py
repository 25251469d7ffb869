"""Regenerates the pictures, tables and figures of the documentation."""
