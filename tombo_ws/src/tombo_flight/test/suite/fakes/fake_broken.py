"""A node that ends at once, for a reason it tells."""

raise SystemExit("Error: parameter detector.threshold: 'x' is not of type double")
