"""Diagnosis of thrust-stand runs."""
