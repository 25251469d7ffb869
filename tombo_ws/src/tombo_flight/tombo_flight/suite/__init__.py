"""The suite as processes: which nodes, with what parameters, under whose eyes."""
