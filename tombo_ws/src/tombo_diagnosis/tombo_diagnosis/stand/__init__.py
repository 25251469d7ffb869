"""Diagnosis of thrust-stand runs: what the propeller model gets wrong, and what the stand does."""
