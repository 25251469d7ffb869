"""The fit of hypotheses to one or more flights."""
