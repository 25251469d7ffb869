"""Blind cases of the stand diagnosis."""
