"""What no candidate explains: drawn against the state, and as a sparse sum of physical terms."""
