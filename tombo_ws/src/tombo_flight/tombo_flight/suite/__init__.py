"""The suite as processes: nodes, their parameters, supervision."""
