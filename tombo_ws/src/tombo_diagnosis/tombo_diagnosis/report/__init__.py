"""Reports and plots of a diagnosis."""
