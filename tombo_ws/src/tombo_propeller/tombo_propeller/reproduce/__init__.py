"""The paper against what the laws compute: every claim with a verdict."""
