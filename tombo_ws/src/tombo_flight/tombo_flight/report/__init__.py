"""Pictures of a flight, and the self-contained HTML report."""
