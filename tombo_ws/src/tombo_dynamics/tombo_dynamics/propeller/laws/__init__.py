"""The three laws of the nodus' equilibrium, and the compiled code that solves them."""
